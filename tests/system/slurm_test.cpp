// A run as a job array of a real Slurm, started here for the test alone: loopback only, its
// files in a temporary folder, a key of its own.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <pwd.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "scale_out.h"
#include "segsim_process.h"
#include "tests/system/gazebo_processes.h"

namespace segsim::tests {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using Clock = std::chrono::steady_clock;

bool is_installed(const std::string& program) {
  return run_shell("command -v " + program).exit_code == 0;
}

int free_port() {
  const int descriptor = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  const bool bound =
      ::bind(descriptor, reinterpret_cast<sockaddr*>(&address), size) == 0 &&
      ::getsockname(descriptor, reinterpret_cast<sockaddr*>(&address), &size) == 0;
  ::close(descriptor);
  return bound ? ntohs(address.sin_port) : 0;
}

/// munged, slurmctld and one node of two slots.
class Slurm {
 public:
  explicit Slurm(const fs::path& folder) : folder_(folder) {
    for (const char* name : {"state", "spool", "munge"})
      fs::create_directories(folder_ / name);
    ::chmod((folder_ / "munge").c_str(), 0711);
    write_configuration();
    ::setenv("SLURM_CONF", (folder_ / "slurm.conf").c_str(), 1);
    core::write_file_atomically(folder_ / "munge" / "key", [](std::ostream& out) {
      for (int k = 0; k < 128; ++k) out << static_cast<char>(std::rand());
    });
    ::chmod((folder_ / "munge" / "key").c_str(), 0400);
    const std::string in = (folder_ / "munge").string() + "/";
    munged_ = start("munged", "munged --foreground --force --num-threads=2 --socket=" + in +
                                  "socket --key-file=" + in + "key --pid-file=" + in +
                                  "pid --seed-file=" + in + "seed --log-file=" + in + "log");
    wait_for([&] { return fs::exists(in + "socket"); }, 10.0);
    controller_ = start("slurmctld", "slurmctld -D -c");
    start_node();
  }
  ~Slurm() {
    run_shell("scancel --user=$(id -un)");
    for (auto* daemon : {&node_, &controller_, &munged_}) {
      if (*daemon != nullptr) (*daemon)->stop(SIGTERM);
    }
  }
  Slurm(const Slurm&) = delete;
  Slurm& operator=(const Slurm&) = delete;

  void start_node() { node_ = start("slurmd", "slurmd -D -N n1"); }
  /// The node dies with everything on it: its daemon, the daemon of each job step, and the
  /// jobs themselves. @return  How many processes of jobs that were.
  int kill_node() {
    const std::vector<pid_t> jobs = processes_of_jobs();
    node_->send(SIGKILL);
    node_->wait(10.0);
    for (const pid_t pid : jobs) {
      if (const pid_t step = step_daemon_of(pid); step > 1) ::kill(step, SIGKILL);
    }
    for (const pid_t pid : jobs) ::kill(pid, SIGKILL);
    return static_cast<int>(jobs.size());
  }
  [[nodiscard]] bool is_up() const {
    return run_shell("sinfo -h -o %T").text.find("idle") != std::string::npos;
  }
  [[nodiscard]] bool has_jobs() const { return !run_shell("squeue -h").text.empty(); }
  /// Slurm waits two minutes before it begins jobs of a lost node again; an administrator who
  /// knows better says so.
  void begin_requeued_now() const {
    run_shell(
        "for job in $(squeue -h -t pending -o %A); do scontrol update JobId=$job "
        "StartTime=now; done");
  }
  [[nodiscard]] std::string logs() const {
    std::string text;
    for (const char* name : {"munged", "slurmctld", "slurmd"}) {
      const fs::path file = folder_ / (std::string(name) + ".log");
      if (fs::exists(file)) text += core::read_file(file);
    }
    return text;
  }
  template <class Condition>
  static bool wait_for(const Condition& condition, double patience_s) {
    const auto end = Clock::now() + std::chrono::duration<double>(patience_s);
    while (!condition()) {
      if (Clock::now() > end) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(200));
    }
    return true;
  }

 private:
  std::unique_ptr<Process> start(const std::string& name, const std::string& line) {
    const std::string path = "PATH=$PATH:/usr/sbin:/sbin; exec " + line;
    return std::make_unique<Process>(std::vector<std::string>{"/bin/sh", "-c", path}, "",
                                     folder_ / (name + ".log"));
  }
  static std::vector<pid_t> processes_of_jobs() {
    const std::string list =
        "for job in $(squeue -h -t running -o %A); do scontrol listpids $job n1; done";
    std::istringstream lines(run_shell(list).text);
    std::vector<pid_t> pids;
    for (std::string line; std::getline(lines, line);) {
      if (const int pid = std::atoi(line.c_str()); pid > 1) pids.push_back(pid);
    }
    return pids;
  }
  /// Its parent, if that is slurmstepd; 0 otherwise.
  static pid_t step_daemon_of(pid_t pid) {
    const auto field = [](pid_t of, const std::string& name) {
      std::ifstream status("/proc/" + std::to_string(of) + "/status");
      for (std::string line; std::getline(status, line);) {
        if (line.rfind(name + ":\t", 0) == 0) return line.substr(name.size() + 2);
      }
      return std::string();
    };
    const pid_t parent = std::atoi(field(pid, "PPid").c_str());
    return field(parent, "Name") == "slurmstepd" ? parent : 0;
  }
  void write_configuration() const {
    const std::string user = ::getpwuid(::geteuid())->pw_name, in = folder_.string() + "/";
    core::write_file_atomically(folder_ / "slurm.conf", [&](std::ostream& out) {
      out << "ClusterName=test\nSlurmctldHost=localhost(127.0.0.1)\nSlurmctldPort="
          << free_port()
          << "\nCommunicationParameters=NoCtldInAddrAny,NoInAddrAny\nAuthType=auth/munge\n"
             "AuthInfo=socket="
          << in << "munge/socket\nMpiDefault=none\nProctrackType=proctrack/linuxproc\n"
          << "TaskPlugin=task/none\nReturnToService=2\nSlurmUser=" << user
          << "\nSlurmdUser=" << user << "\nStateSaveLocation=" << in
          << "state\nSlurmdSpoolDir=" << in << "spool\nSlurmctldPidFile=" << in
          << "slurmctld.pid\nSlurmdPidFile=" << in << "slurmd.pid\nSwitchType=switch/none\n"
          << "SchedulerParameters=sched_interval=1,bf_interval=1,batch_sched_delay=0,"
             "sched_min_interval=100000\nSelectType=select/cons_tres\n"
             "SelectTypeParameters=CR_Core\nAccountingStorageType=accounting_storage/none\n"
             "JobCompType=jobcomp/none\nJobRequeue=1\nKillWait=2\nSlurmdTimeout=5\n"
             "InactiveLimit=0\nReconfigFlags=KeepPartState\n"
             "NodeName=n1 NodeHostname=localhost NodeAddr=127.0.0.1 Port="
          << free_port()
          << " CPUs=2 State=UNKNOWN\n"
             "PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP\n";
    });
  }

  fs::path folder_;
  std::unique_ptr<Process> munged_, controller_, node_;
};

/// Four tasks on two slots; the node is killed while they run, and comes back. The table is
/// that of a run by one process.
TEST(SlurmArray, SurvivesItsNode) {
  if (!is_installed("PATH=$PATH:/usr/sbin slurmctld") && !fs::exists("/usr/sbin/slurmctld")) {
    GTEST_SKIP() << "Slurm is not installed (tools/debian_test_packages.txt)";
  }
  const ScaleOutFolder folder(80);
  const ProcessOutput whole = folder.segsim("whole", "--workers 2");
  ASSERT_EQ(whole.exit_code, 0) << whole.text;
  ASSERT_EQ(folder.segsim("parts", "--prepare-only").exit_code, 0);

  Slurm slurm(folder.path() / "slurm");
  ASSERT_TRUE(Slurm::wait_for([&] { return slurm.is_up(); }, 20.0)) << slurm.logs();
  const std::string log = (folder.path() / "task-%a.log").string();
  const std::string job = "SEGSIM='" SEGSIM_BINARY "' sbatch --array=0-3 --output='" + log +
                          "' " + SEGSIM_ENGINES + "/slurm_array.sh" +
                          folder.arguments("parts", "").substr(std::string(" run").size());
  const ProcessOutput submitted = run_shell(job);
  ASSERT_EQ(submitted.exit_code, 0) << submitted.text << slurm.logs();
  const fs::path first = folder.path() / "parts/shards/0-of-4/results.sqlite";
  ASSERT_TRUE(Slurm::wait_for([&] { return fs::exists(first); }, 60.0))
      << run_shell("squeue").text << slurm.logs();

  EXPECT_GT(slurm.kill_node(), 0) << run_shell("squeue").text;
  slurm.start_node();
  const auto ended = [&] {
    slurm.begin_requeued_now();
    return !slurm.has_jobs();
  };
  ASSERT_TRUE(Slurm::wait_for(ended, 90.0)) << run_shell("squeue; sinfo").text << slurm.logs();

  const ProcessOutput merged = run_segsim("merge " + folder.quoted("parts"));
  ASSERT_EQ(merged.exit_code, 0) << merged.text;
  EXPECT_THAT(merged.text, HasSubstr(std::to_string(folder.trials()) + " of " +
                                     std::to_string(folder.trials()) + " trials are done"));
  EXPECT_EQ(sha256_in(merged.text), sha256_in(whole.text));
  EXPECT_EQ(folder.table("parts"), folder.table("whole"));
}

}  // namespace
}  // namespace segsim::tests
