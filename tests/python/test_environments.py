"""One environment: as Gymnasium wants it, and as a trial of the program has it."""

import pathlib
import subprocess
import sys
import warnings

import numpy as np
import pytest

import fastsegsim

gymnasium = pytest.importorskip("gymnasium", reason="Gymnasium is not installed")
# Looked up and not imported: a package without environments is to fail here, not to be skipped.
import fastsegsim.environments as environments  # noqa: E402
from gymnasium.utils.env_checker import check_env  # noqa: E402

SIZE = (64, 48)  # As in tests/python/tiny_trial.cpp.
COUCH_M = np.array([2.95, -1.95])


@pytest.fixture(scope="module")
def make(tiny):
    """Environments with the episodes of the file; those that were made are kept, because loading takes time."""
    made = {}

    def make_one(**settings):
        key = repr(sorted(settings.items()))
        if key not in made:
            made[key] = environments.ObjectNavEnv(tiny.bundle, tiny.episodes, size=SIZE, **settings)
        return made[key]

    return make_one


def same(one, other):
    """Whether observations or information are the same to the bit."""
    return one.keys() == other.keys() and all(np.array_equal(one[name], other[name]) for name in one)


def drive_to_the_couch(environment, episode, places_m):
    """Discrete actions that find the couch from a start in its room: to a view point, then facing it."""
    _, info = environment.reset(seed=0, options={"episode": episode})
    actions, target_m = [], min(places_m, key=lambda p: np.hypot(*(p - info["true_pose"][:2])))
    for _ in range(100):
        x, y, yaw = info["true_pose"]
        there = np.hypot(*(target_m - (x, y))) < 0.3
        to = (COUCH_M if there else target_m) - (x, y)
        off = (np.arctan2(to[1], to[0]) - yaw + np.pi) % (2 * np.pi) - np.pi
        actions.append(2 if off > 0.27 else 3 if off < -0.27 else 0 if there else 1)
        _, _, terminated, _, info = environment.step(actions[-1])
        if terminated:
            return actions, info
    raise AssertionError("the couch was not reached")


def near_couch(tiny):
    """An episode that starts in the room of the couch, and the places where it is seen from."""
    for number, episode in enumerate(tiny.listed):
        if episode["class"] == "couch" and episode["start"][0] > 0.5:
            return number, np.array(episode["view_points"])
    raise AssertionError("no such episode")


@pytest.mark.parametrize("action", ["discrete", "continuous"])
def test_gymnasiums_checker_finds_nothing_wrong(tiny, action):
    environment = gymnasium.make("SegSim/ObjectNav-v0", scene=str(tiny.bundle), episodes=str(tiny.episodes), size=SIZE,
                                 action=action, render_mode="rgb_array", images=["rgb", "depth", "semantic"])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(environment.unwrapped)
    # The pose has no bounds, and speeds are those of the robot, not 1; nothing else is remarkable.
    said = [str(warning.message) for warning in caught]
    assert all("probably too" in text or "symmetric and normalized" in text for text in said), said
    observation, _ = environment.reset(seed=1)
    np.testing.assert_array_equal(environment.render(), observation["rgb"])


def test_observations_are_what_the_spaces_say(tiny, make):
    environment = make(images=["rgb", "depth", "semantic", "instance"])
    observation, info = environment.reset(seed=3)
    assert set(observation) == {"rgb", "depth", "semantic", "instance", "pose", "goal"}
    assert observation in environment.observation_space
    assert observation["rgb"].std() > 5
    assert 0.5 < observation["depth"].max() <= 6.0 and observation["depth"].min() >= 0.0
    assert {1, 2} <= set(np.unique(observation["semantic"]))
    np.testing.assert_array_equal(observation["pose"], 0.0)
    assert environment.goal_classes[observation["goal"]] == info["goal"]
    scene_ids = {c.name: c.id for c in fastsegsim.Scene.load(tiny.bundle).classes}
    assert environment.goal_class_ids.tolist() == [scene_ids[name] for name in environment.goal_classes]


def test_random_commands_end_as_in_a_trial(tiny, make):
    environment = make(action="continuous", robot="jackal-gentle")
    random = np.random.default_rng(5)
    contacts = 0
    for episode in range(4):
        commands = random.uniform((-0.3, -2), (1, 2), (60, 2))
        trial = tiny.trial(episode, commands, "jackal-gentle")
        observation, info = environment.reset(options={"episode": episode})
        poses = [info["true_pose"]]
        for v, w in commands:
            *_, info = environment.step([v, w, -1.0])
            poses.append(info["true_pose"])
        *_, terminated, truncated, info = environment.step([0.0, 0.0, 1.0])
        assert terminated and not truncated
        np.testing.assert_array_equal(poses, trial["poses"])
        for name in ("outcome", "success", "spl", "soft_spl", "distance_m", "path_m", "collisions"):
            assert info[name] == trial[name], name
        contacts += info["collisions"]
    assert contacts > 0


def test_a_success_of_discrete_actions_is_that_of_a_trial(tiny, make):
    environment = make()
    episode, places_m = near_couch(tiny)
    actions, info = drive_to_the_couch(environment, episode, places_m)
    commands = [command for action in actions for command in environment.commands_of(action)]
    trial = tiny.trial(episode, commands)
    assert info["success"] and info["outcome"] == trial["outcome"] == "success"
    for name in ("spl", "soft_spl", "distance_m", "path_m", "collisions"):
        assert info[name] == trial[name], name
    assert 0.5 < info["spl"] <= 1.0
    np.testing.assert_array_equal(info["true_pose"], trial["poses"][-1])
    assert info["time_s"] == pytest.approx(0.1 * len(commands))


def test_rewards_are_progress_and_success(tiny, make):
    episode, places_m = near_couch(tiny)
    actions, _ = drive_to_the_couch(make(), episode, places_m)
    for settings, success in (({}, 2.5), ({"success_reward": 10.0}, 10.0), ({"rewards": False}, None)):
        environment = make(**settings)
        _, first = environment.reset(options={"episode": episode})
        rewards = [environment.step(action)[1] for action in actions[:-1]]
        _, last_reward, _, _, last = environment.step(actions[-1])
        if success is None:
            assert not any(rewards) and last_reward == 0.0 and last["success"]
        else:
            assert sum(rewards) == pytest.approx(first["distance_m"] - last["distance_m"])
            assert last_reward == pytest.approx(success)
    assert first["distance_m"] == pytest.approx(first["shortest_path_m"])


def test_a_discrete_step_goes_as_far_as_it_says(tiny, make):
    environment = make(forward_step_m=0.4, turn_step_rad=0.3)
    episode, _ = near_couch(tiny)
    environment.reset(options={"episode": episode})
    observation = environment.step(2)[0]
    np.testing.assert_allclose(observation["pose"], (0, 0, 0.3), atol=1e-6)
    observation, *_, info = environment.step(1)
    if not info["collided"]:
        np.testing.assert_allclose(observation["pose"], (0.4 * np.cos(0.3), 0.4 * np.sin(0.3), 0.3), atol=1e-6)
    observation = environment.step(3)[0]
    assert observation["pose"][2] == pytest.approx(0.0, abs=1e-6)


def test_seeds_repeat_everything(make):
    environment = make(localisation="odometry")

    def run(seed):
        seen = [environment.reset(seed=seed)]
        for action in (2, 1, 1, 3, 1, 0):
            seen.append(environment.step(action))
        return [*seen, environment.reset()]

    one, again, other = run(4), run(4), run(5)
    for a, b in zip(one, again):
        assert same(a[0], b[0]) and same(a[-1], b[-1]) and a[1:-1] == b[1:-1]
    assert not same(one[0][0], other[0][0])
    assert one[0][1]["episode_id"] != one[-1][1]["episode_id"]
    # What it believes is not where it is.
    assert np.any(one[3][0]["pose"] != make().reset(seed=4)[0]["pose"])


def test_episodes_come_in_the_order_that_was_asked_for(tiny, make):
    ids = [episode["id"] for episode in tiny.listed]
    assert make().episode_ids == ids and make().infeasible_episodes == 0
    turn = make(order="in_turn", images=["depth"])
    turn.reset(seed=1)
    assert [turn.reset()[1]["episode_id"] for _ in ids] == ids[1:] + ids[:1]
    shuffled = [make().reset(seed=1)[1]["episode_id"]] + [make().reset()[1]["episode_id"] for _ in ids[1:]]
    assert sorted(shuffled) == sorted(ids) and shuffled != ids
    assert make().reset(options={"episode": ids[5]})[1]["episode_number"] == 5


def test_without_a_file_episodes_are_made(tiny):
    environment = environments.ObjectNavEnv(tiny.bundle, size=SIZE, goals=["chair"], episode_count=5, episode_seed=3)
    assert len(environment.episode_ids) == 5 and environment.goal_classes == ["chair"]
    again = environments.ObjectNavEnv(tiny.bundle, size=SIZE, goals=["chair"], episode_count=5, episode_seed=3)
    other = environments.ObjectNavEnv(tiny.bundle, size=SIZE, goals=["chair"], episode_count=5, episode_seed=4)
    start = [one.reset(options={"episode": 2})[1]["true_pose"].tolist() for one in (environment, again, other)]
    assert start[0] == start[1] != start[2]
    # Numbers of goals can be those of a larger set of classes.
    wide = environments.ObjectNavEnv(tiny.bundle, tiny.episodes, size=SIZE, goal_classes=["bed", "chair", "couch"])
    assert wide.observation_space["goal"].n == 3 and wide.goal_class_ids.tolist()[0] == 0
    observation, info = wide.reset(seed=0)
    assert wide.goal_classes[observation["goal"]] == info["goal"] != "bed"


def test_time_runs_out(make):
    environment = make(time_limit_s=1.0)
    environment.reset(seed=0)
    ends = [environment.step(2)[2:4] for _ in range(3)]
    # A turn takes four periods: after two there is time for two more, and a third one is cut off.
    assert ends[-1] == (False, True) and ends[0] == ends[1] == (False, False)
    with pytest.raises(fastsegsim.InputError, match="reset"):
        environment.step(1)
    assert environment.reset()[1]["outcome"] == ""


def test_episodes_that_are_none_are_refused(make):
    environment = make()
    for episode in (-1, -5, 7.9, True, 1000, "none"):
        with pytest.raises(fastsegsim.InputError, match="episode"):
            environment.reset(options={"episode": episode})


def test_steps_that_a_robot_cannot_make_are_refused(make):
    with pytest.raises(fastsegsim.InputError, match="forward_step_m"):
        make(control_period_s=0.005, forward_step_m=10.0)


def test_a_contact_can_end_an_episode(make):
    for contact, ended in (("stop", False), ("slide", False), ("end", True)):
        environment = make(contact=contact)
        environment.reset(seed=0)
        for _ in range(60):
            *_, terminated, truncated, info = environment.step(1)
            if info["collided"]:
                break
        assert info["collided"] and info["collisions"] == 1
        assert (terminated, truncated) == (ended, False)
        assert info["outcome"] == ("collision" if ended else "")


def test_observations_are_not_used_again(make):
    environment = make()
    first, _ = environment.reset(seed=0)
    kept = {name: value.copy() for name, value in first.items()}
    environment.step(2)
    environment.reset(seed=1)
    assert same(first, kept)


def test_the_example_trains(tiny):
    path = pathlib.Path(__file__).resolve().parents[2] / "python" / "examples" / "train_policy.py"
    printed = subprocess.run([sys.executable, path, tiny.bundle, "--minutes", "0", "--robots", "4", "--evaluate", "4"],
                             check=True, capture_output=True, text=True).stdout
    assert "before: " in printed and "round 1: earned " in printed and "after: " in printed
    assert printed.count("95 % interval") == 2 and "nan" not in printed
