"""Several environments: as Gymnasium wants them, and each as it would be alone."""

import pathlib
import re
import subprocess
import sys
import threading

import numpy as np
import pytest

import fastsegsim

gymnasium = pytest.importorskip("gymnasium", reason="Gymnasium is not installed")
import fastsegsim.environments as environments  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402

SIZE = (32, 24)
COUNT = 3


@pytest.fixture(scope="module")
def make(tiny):
    def make_one(count=COUNT, **settings):
        return environments.ObjectNavVectorEnv(tiny.bundle, tiny.episodes, num_envs=count,
                                               **{"size": SIZE, "time_limit_s": 4.0, **settings})

    return make_one


def run(environment, seed, steps=25):
    """All that environments show in some steps with random actions."""
    random = np.random.default_rng(seed)
    shown = [environment.reset(seed=seed)]
    for _ in range(steps):
        shown.append(environment.step(random.choice(4, environment.num_envs, p=(.05, .45, .25, .25))))
    return shown


def arrays_of(shown):
    """Every array, with where it comes from."""
    for step, parts in enumerate(shown):
        for k, part in enumerate(parts):
            for name, values in part.items() if isinstance(part, dict) else [("", part)]:
                yield f"{step}/{k}/{name}", values


def assert_same(one, other):
    one, other = dict(arrays_of(one)), dict(arrays_of(other))
    assert one.keys() == other.keys()
    for place, values in one.items():
        np.testing.assert_array_equal(values, other[place], err_msg=place)


def test_it_is_a_vector_environment_of_gymnasium(tiny):
    environment = gymnasium.make_vec("SegSim/ObjectNav-v0", num_envs=COUNT, vectorization_mode="vector_entry_point",
                                     scene=str(tiny.bundle), episodes=str(tiny.episodes), size=SIZE,
                                     render_mode="rgb_array")
    assert isinstance(environment.unwrapped, environments.ObjectNavVectorEnv)
    assert environment.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    observations, info = environment.reset(seed=2)
    assert observations in environment.observation_space and environment.action_space.shape == (COUNT,)
    environment.action_space.seed(1)
    observations, rewards, terminated, truncated, info = environment.step(environment.action_space.sample())
    assert observations in environment.observation_space
    assert (rewards.dtype, terminated.dtype, truncated.dtype) == (np.float64, np.bool_, np.bool_)
    assert all(info[f"_{name}"].all() for name in info if not name.startswith("_"))
    assert [picture.shape for picture in environment.render()] == [(24, 32, 3)] * COUNT
    recorded = gymnasium.wrappers.vector.RecordEpisodeStatistics(environment)
    recorded.reset(seed=1)
    assert recorded.step(np.zeros(COUNT, int))[4]["episode"]["l"].tolist() == [1] * COUNT


def test_threads_change_nothing(make):
    one = run(make(threads=1, images=["rgb", "depth", "semantic"]), 5)
    assert sum(parts[2].sum() for parts in one[1:]) > 0, "no episode was stopped"
    assert sum(parts[3].sum() for parts in one[1:]) > 0, "no episode was cut short"
    for threads in (2, 4):
        assert_same(run(make(threads=threads, images=["rgb", "depth", "semantic"]), 5), one)


def test_each_is_as_it_would_be_alone(tiny, make):
    seed, together = 8, run(make(), 8)
    for i in range(COUNT):
        single = environments.ObjectNavEnv(tiny.bundle, tiny.episodes, size=SIZE, time_limit_s=4.0)
        random = np.random.default_rng(seed)
        observation, info = single.reset(seed=seed + i)
        over = False
        for parts in together:
            if parts is not together[0]:
                action = random.choice(4, COUNT, p=(.05, .45, .25, .25))[i]
                if over:
                    observation, info = single.reset()
                    reward, terminated, truncated = 0.0, False, False
                else:
                    observation, reward, terminated, truncated, info = single.step(action)
                over = terminated or truncated
                assert (reward, terminated, truncated) == tuple(part[i] for part in parts[1:4])
            for name, values in observation.items():
                np.testing.assert_array_equal(values, parts[0][name][i], err_msg=name)
            for name, value in info.items():
                np.testing.assert_array_equal(value, parts[-1][name][i], err_msg=name)


def test_the_step_after_the_end_begins_the_next_episode(make):
    environment = make()
    _, before = environment.reset(seed=1)
    _, _, terminated, _, info = environment.step([0, 2, 2])
    assert terminated.tolist() == [True, False, False]
    assert info["outcome"].tolist()[1:] == ["", ""] and info["outcome"][0] in ("stopped_far", "not_visible", "success")
    observations, rewards, terminated, truncated, info = environment.step([0, 2, 2])  # This STOP does not count.
    assert not terminated.any() and not truncated.any() and rewards[0] == 0.0
    np.testing.assert_array_equal(observations["pose"][0], 0.0)
    assert info["time_s"][0] == 0.0 and info["time_s"][1] > 0.0 and info["outcome"][0] == ""
    same_episode = info["episode_number"] == before["episode_number"]
    assert same_episode.tolist() == [False, True, True]
    assert environment.step([0, 2, 2])[2].tolist() == [True, False, False]


def test_seeds_repeat_and_differ(make):
    environment = make()
    one = run(environment, 3, 5)
    assert_same(run(environment, 3, 5), one)
    assert not np.array_equal(run(environment, 4, 5)[0][0]["rgb"], one[0][0]["rgb"])
    # One seed for each, and all alike: the same episodes for several policies.
    observations, info = environment.reset(seed=[7] * COUNT)
    assert len(set(info["episode_number"])) == 1 and np.all(observations["rgb"] == observations["rgb"][0])
    first = info["episode_number"].tolist()
    assert environment.reset(seed=[7, 8, 9])[1]["episode_number"][0] == first[0]
    # Without a seed the order goes on.
    assert environment.reset()[1]["episode_number"][0] != first[0]


def test_in_turn_every_episode_is_met_once(tiny, make):
    environment = make(count=4, order="in_turn", images=["depth"])
    _, info = environment.reset(seed=0)
    met = [*info["episode_id"]]
    for _ in range(2 * (len(tiny.listed) // 4 - 1)):
        *_, info = environment.step([0] * 4)
        met += [episode for episode, time_s in zip(info["episode_id"], info["time_s"]) if episode not in met]
    assert sorted(met) == sorted(episode["id"] for episode in tiny.listed)


def test_continuous_actions(make):
    environment = make(action="continuous", robot="turtlebot3-waffle")
    np.testing.assert_allclose(environment.single_action_space.high, (0.26, 1.82, 1.0), rtol=1e-6)
    environment.reset(seed=0)
    observations, _, terminated, _, info = environment.step([[0.2, 0, 0], [0, 1, 0.5], [0, 0, 0.51]])
    assert terminated.tolist() == [False, False, True]  # STOP lies above 0.5.
    assert info["time_s"].tolist() == [0.1, 0.1, 0.0]
    assert observations["pose"][0, 0] > 0 and observations["pose"][1, 2] > 0


def test_other_threads_run_while_environments_step(make):
    environment = make(threads=1)
    environment.reset(seed=0)
    begin, ran = threading.Event(), []

    def other():
        begin.wait()
        ran.append(True)

    thread = threading.Thread(target=other)
    thread.start()
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(1000)  # Python takes the lock from nobody: who runs meanwhile was let run.
    try:
        begin.set()
        for _ in range(1000):
            environment._batch.step(np.array([1, 2, 3]))
            if ran:
                break
        assert ran
    finally:
        sys.setswitchinterval(interval_s)
        thread.join()


@pytest.mark.parametrize("settings, words", [
    ({"nothing": 1}, "time_limit_s, turn_step_rad, visible_pixels, found nothing"),
    ({"size": (0, 24)}, "size: expected width and height of 1 to 8192 pixels, found 0 x 24"),
    ({"size": "large"}, "size: expected a value like (256, 192), found 'large'"),
    ({"horizontal_fov_rad": 4.0}, "horizontal_fov_rad: expected 0.174533 to 2.61799, found 4"),
    ({"horizontal_fov_rad": float("nan")}, "horizontal_fov_rad: expected 0.174533 to 2.61799, found nan"),
    ({"images": ["rgb", "normal"]}, 'images: expected rgb | depth | semantic | instance, found "normal"'),
    ({"action": "wheels"}, 'action: expected discrete | continuous, found "wheels"'),
    ({"contact": "bounce"}, 'contact: expected stop | slide | end, found "bounce"'),
    ({"collision": "none"}, 'collision: expected footprint | navmesh, found "none"'),
    ({"localisation": "slam"}, 'localisation: expected exact | odometry | localiser, found "slam"'),
    ({"order": "random"}, 'order: expected shuffled | in_turn, found "random"'),
    ({"control_period_s": 0.013}, "control_period_s: expected a multiple of 0.005 s, found 0.013"),
    ({"time_limit_s": 0.01}, "time_limit_s: expected 0.1 to 100000, found 0.01"),
    ({"robot": "tank"}, "tank"),
    ({"goals": ["bed"]}, "an episode that jackal can do"),
    ({"goal_classes": ["chair"]}, "goal_classes: expected the class of every goal, found no couch"),
    ({"count": 0}, "num_envs: expected 1 to 4096, found 0"),
    ({"threads": 0}, "threads: expected 1 to 4096, found 0"),
    ({"render_mode": "human"}, "render_mode: expected None or rgb_array, found human"),
    ({"render_mode": "rgb_array", "images": ["depth"]}, "render_mode: expected None where images lack rgb"),
])
def test_settings_that_are_none_are_refused(make, settings, words):
    with pytest.raises(fastsegsim.InputError, match=re.escape(words)):
        make(**settings)


@pytest.mark.parametrize("action, actions, words", [
    ("discrete", [0, 1, 4], "actions: expected 0 (stop), 1 (forward), 2 (left) or 3 (right), found 4"),
    ("discrete", [0, 1], "actions: expected shape [3], found [2]"),
    ("discrete", [0.5, 1, 1], "actions: expected integers, found float64"),
    ("continuous", [[0, 0, 0]] * 2, "actions: expected shape [3, 3], found [2, 3]"),
    ("continuous", [[0, 0, 0], [0, 0, 0], [0, float("inf"), 0]], "actions: expected finite numbers, found inf"),
    ("continuous", ["fast"] * 3, "actions: expected numbers, found <U4"),
])
def test_actions_that_are_none_are_refused(make, action, actions, words):
    environment = make(action=action)
    with pytest.raises(fastsegsim.InputError, match="reset"):
        environment.step(actions)
    environment.reset(seed=0)
    with pytest.raises(fastsegsim.InputError, match=re.escape(words)):
        environment.step(actions)


def test_files_that_are_none_are_refused(tiny, bundle, tmp_path):
    with pytest.raises(fastsegsim.InputError, match="expected a scene bundle with scene.yaml"):
        environments.ObjectNavEnv(tmp_path)
    with pytest.raises(fastsegsim.InputError, match="for rendering and labels only|it has no floor"):
        environments.ObjectNavEnv(bundle)
    with pytest.raises(fastsegsim.InputError, match="none.jsonl"):
        environments.ObjectNavEnv(tiny.bundle, tmp_path / "none.jsonl")
    text = tiny.episodes.read_text().splitlines()
    broken = tmp_path / "broken.jsonl"
    broken.write_text("\n".join([*text[:3], text[3].replace("couch", "sofa").replace("chair", "sofa"), *text[4:]]))
    with pytest.raises(fastsegsim.InputError, match='broken.jsonl: tiny/sofa/..: expected a class of .* found "sofa"'):
        environments.ObjectNavEnv(tiny.bundle, broken)
    other = tmp_path / "other.jsonl"
    other.write_text(tiny.episodes.read_text().replace('"scene_sha256":"', '"scene_sha256":"0'))
    with pytest.raises(fastsegsim.InputError, match="other.jsonl: expected episodes of the bundle"):
        environments.ObjectNavEnv(tiny.bundle, other)


def test_resets_that_are_none_are_refused(tiny, make):
    single = environments.ObjectNavEnv(tiny.bundle, tiny.episodes, size=SIZE)
    with pytest.raises(fastsegsim.InputError, match="episode: expected 0 to 11, found 12"):
        single.reset(options={"episode": 12})
    with pytest.raises(fastsegsim.InputError, match="episode: expected the id of one of 12 episodes, found tiny"):
        single.reset(options={"episode": "tiny"})
    with pytest.raises(fastsegsim.InputError, match="options: expected episode, found level"):
        single.reset(options={"level": 1})
    with pytest.raises(fastsegsim.InputError, match="seed: expected one for each of 3 environments, found 2"):
        make().reset(seed=[1, 2])


def test_an_episode_that_cannot_be_done_is_left_out(tiny, tmp_path):
    lines = tiny.episodes.read_text().splitlines()
    # In a wall.
    start = tiny.listed[2]["start"]
    lines[3] = lines[3].replace(f'"start":[{start[0]!r},{start[1]!r}', '"start":[0.0,-1.0')
    assert "[0.0,-1.0" in lines[3]
    blocked = tmp_path / "blocked.jsonl"
    blocked.write_text("\n".join(lines) + "\n")
    environment = environments.ObjectNavEnv(tiny.bundle, pathlib.Path(blocked), size=SIZE)
    assert environment.infeasible_episodes == 1
    assert environment.episode_ids == [e["id"] for k, e in enumerate(tiny.listed) if k != 2]


def test_the_benchmark_measures_both(tiny):
    ran = subprocess.run([sys.executable, pathlib.Path(__file__).parent / "bench_environments.py", tiny.program,
                          "--steps", "2", "--rounds", "1", "--folder", tiny.folder],
                         check=True, capture_output=True, text=True).stdout
    for size in ("128 x 128", "256 x 192"):
        assert re.search(size + r": C\+\+ \d+ \(\d+\.\d+ ms .*, Python \d+ \(\d+\.\d+ ms, [+-]\d+\.\d%\)", ran), ran


def test_threads_may_share_an_object(make):
    environment = make(time_limit_s=100.0, threads=1)
    environment.reset(seed=0)
    times_s = []

    def turn():
        for _ in range(15):
            times_s.append(environment.step([2, 3, 2])[-1]["time_s"].tolist())

    threads = [threading.Thread(target=turn) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    np.testing.assert_allclose(sorted(times_s), [[0.1 * 4 * k] * COUNT for k in range(1, 31)])
