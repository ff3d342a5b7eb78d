#pragma once

/// @file
/// A browser that is driven: its mouse and keyboard, through Chromium's DevTools protocol over
/// two pipes (JSON with a zero byte behind each message).

#include <fcntl.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/experiments/browser.h"

namespace segsim::tests {

class BrowserSession {
 public:
  using Json = nlohmann::json;

  /// @param scratch  Folder for the browser's profile and log.
  BrowserSession(const std::string& address, const std::filesystem::path& scratch,
                 int width_px, int height_px) {
    int to[2], from[2];
    if (::pipe(to) != 0 || ::pipe(from) != 0) throw std::runtime_error("no pipes");
    child_ = ::fork();
    if (child_ == 0) {
      ::setpgid(0, 0);
      // The browser reads from 3 and writes to 4; the numbers may be taken by other ends.
      const int read_end = ::fcntl(to[0], F_DUPFD, 10),
                write_end = ::fcntl(from[1], F_DUPFD, 10);
      const int log =
          ::open((scratch / "browser.log").c_str(), O_CREAT | O_WRONLY | O_TRUNC, 0644);
      ::dup2(log, 2);
      ::dup2(read_end, 3);
      ::dup2(write_end, 4);
      for (int k = 5; k < 64; ++k) ::close(k);
      const std::string profile = "--user-data-dir=" + (scratch / "driven_profile").string();
      const std::string size =
          "--window-size=" + std::to_string(width_px) + "," + std::to_string(height_px);
      ::execlp("chromium", "chromium", "--headless=new", "--no-sandbox", "--disable-gpu",
               "--disable-dev-shm-usage", "--hide-scrollbars", "--remote-debugging-pipe",
               "--no-first-run", profile.c_str(), size.c_str(), "about:blank",
               static_cast<char*>(nullptr));
      ::_exit(127);
    }
    ::close(to[0]);
    ::close(from[1]);
    write_ = to[1];
    read_ = from[0];
    const std::string target =
        call("Target.createTarget", {{"url", "about:blank"}}).at("targetId");
    session_ = call("Target.attachToTarget", {{"targetId", target}, {"flatten", true}})
                   .at("sessionId");
    call("Runtime.enable");
    call("Log.enable");
    call("Page.enable");
    call("Emulation.setDeviceMetricsOverride", {{"width", width_px},
                                                {"height", height_px},
                                                {"deviceScaleFactor", 1},
                                                {"mobile", false}});
    call("Page.navigate", {{"url", address}});
  }
  ~BrowserSession() {
    ::close(write_);
    ::close(read_);
    ::kill(-child_, SIGKILL);
    ::waitpid(child_, nullptr, 0);
  }
  BrowserSession(const BrowserSession&) = delete;
  BrowserSession& operator=(const BrowserSession&) = delete;

  /// Value of a JavaScript expression in the page.
  Json evaluate(const std::string& expression) {
    const Json answer =
        call("Runtime.evaluate",
             {{"expression", expression}, {"returnByValue", true}, {"awaitPromise", true}});
    return answer.at("result").value("value", Json());
  }
  /// Until the expression is true, for half a minute at most.
  bool wait_for(const std::string& expression) {
    for (int k = 0; k < 600; ++k) {
      if (evaluate(expression) == true) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    ADD_FAILURE() << expression << " is still not true; the page says: "
                  << evaluate("document.body ? document.body.innerText : ''");
    return false;
  }
  std::string text(const std::string& id) {
    return evaluate("document.getElementById('" + id + "').textContent").get<std::string>();
  }

  /// In the page's own pixels.
  void click(double x_px, double y_px, int modifiers = 0) {
    for (const char* type : {"mouseMoved", "mousePressed", "mouseReleased"}) {
      call("Input.dispatchMouseEvent", {{"type", type},
                                        {"x", x_px},
                                        {"y", y_px},
                                        {"button", type[5] == 'M' ? "none" : "left"},
                                        {"modifiers", modifiers},
                                        {"clickCount", type[5] == 'M' ? 0 : 1}});
    }
  }
  void move_to(double x_px, double y_px) {
    call("Input.dispatchMouseEvent", {{"type", "mouseMoved"}, {"x", x_px}, {"y", y_px}});
  }
  /// The middle of an element. @param selector  Of style sheets.
  void click(const std::string& selector) {
    const Json at = evaluate("(() => { const e = document.querySelector('" + selector +
                             "'); e.scrollIntoView({block: 'nearest'}); const box = "
                             "e.getBoundingClientRect(); return [box.left + box.width / 2, "
                             "box.top + box.height / 2]; })()");
    click(at.at(0).get<double>(), at.at(1).get<double>());
  }
  /// @param key  As in KeyboardEvent.key: "Enter", "z".  @param modifiers  2: Ctrl, 8: Shift.
  void press(const std::string& key, int modifiers = 0) {
    const bool enter = key == "Enter";
    Json event{{"type", enter ? "keyDown" : "rawKeyDown"},
               {"key", key},
               {"code", key.size() == 1
                            ? "Key" + std::string(1, static_cast<char>(std::toupper(key[0])))
                            : key},
               {"windowsVirtualKeyCode", enter             ? 13
                                         : key.size() == 1 ? std::toupper(key[0])
                                                           : 0},
               {"modifiers", modifiers}};
    if (enter) event["text"] = "\r";
    call("Input.dispatchKeyEvent", event);
    event["type"] = "keyUp";
    event.erase("text");
    call("Input.dispatchKeyEvent", event);
  }
  /// Into the element that has the focus.
  void type(const std::string& text) { call("Input.insertText", {{"text", text}}); }

  void screenshot(const std::filesystem::path& file) {
    const std::string base64 = call("Page.captureScreenshot").at("data");
    std::string bytes;
    unsigned bits = 0, value = 0;
    for (const char c : base64) {
      const std::size_t digit =
          std::string_view("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/")
              .find(c);
      if (digit == std::string_view::npos) break;
      value = value << 6U | static_cast<unsigned>(digit);
      bits += 6;
      if (bits < 8) continue;
      bits -= 8;
      bytes += static_cast<char>(value >> bits & 255U);
    }
    core::write_file_atomically(file, [&](std::ostream& out) { out << bytes; });
  }

  /// Errors and warnings of the page until now.
  [[nodiscard]] const std::vector<std::string>& complaints() const { return complaints_; }

 private:
  Json call(const std::string& method, const Json& parameters = Json::object()) {
    Json message{{"id", ++last_id_}, {"method", method}, {"params", parameters}};
    if (!session_.empty()) message["sessionId"] = session_;
    const std::string text = message.dump() + '\0';
    if (::write(write_, text.data(), text.size()) != static_cast<ssize_t>(text.size())) {
      throw std::runtime_error("the browser does not listen");
    }
    for (;;) {
      const Json answer = receive();
      if (answer.value("id", 0) == last_id_) {
        if (answer.contains("error"))
          throw std::runtime_error(method + answer["error"].dump());
        return answer.at("result");
      }
      const std::string event = answer.value("method", "");
      if (event == "Runtime.exceptionThrown" || event == "Log.entryAdded") {
        complaints_.push_back(answer.at("params").dump());
      }
    }
  }
  Json receive() {
    std::size_t end = buffer_.find('\0');
    while (end == std::string::npos) {
      pollfd ready{read_, POLLIN, 0};
      char bytes[65536];
      const ssize_t size =
          ::poll(&ready, 1, 60'000) == 1 ? ::read(read_, bytes, sizeof bytes) : 0;
      if (size <= 0) throw std::runtime_error("the browser does not answer");
      buffer_.append(bytes, static_cast<std::size_t>(size));
      end = buffer_.find('\0');
    }
    Json message = Json::parse(buffer_.substr(0, end));
    buffer_.erase(0, end + 1);
    return message;
  }

  pid_t child_ = -1;
  int write_ = -1, read_ = -1, last_id_ = 0;
  std::string session_, buffer_;
  std::vector<std::string> complaints_;
};

}  // namespace segsim::tests
