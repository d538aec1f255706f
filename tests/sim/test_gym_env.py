"""The environment of Gymnasium keeps to its interface, and drives as the closed loop does."""

from functools import cache

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="gymnasium is an extra: pip install 'foresee-nav[gym]'")

import gymnasium
from gymnasium.utils.env_checker import check_env

import sim.gym_env
from foresee.gym import SUITES
from sim import DubinsCar, Lidar
from sim.controller import ControllerDriver
from sim.episode import EpisodeConfig, run_episode
from sim.families import generate
from sim.gym_env import COLLISION, as_driver
from sim.suite import Suite, suites
from sim.task import NoTaskError

FULL_AHEAD = np.array([1.0, 0.0], dtype=np.float32)


def test_each_suite_has_an_environment():
    assert set(SUITES.values()) == set(suites())


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("name", "observe"), [("foresee/Corridor-v1", "scan"), ("foresee/Mixed-v1", "map")]
)
def test_it_passes_the_checker_of_gymnasium(name, observe):
    check_env(gymnasium.make(name, observe=observe).unwrapped)


def test_it_runs_as_a_vector():
    envs = gymnasium.make_vec("foresee/Corridor-v1", num_envs=2)
    observed, _ = envs.reset(seed=0)
    assert observed["scan"].shape == (2, 109)
    observed, rewards, *_ = envs.step(np.array([FULL_AHEAD] * 2))
    assert rewards.shape == (2,)
    assert observed["motion"][:, 0] == pytest.approx(0.15)


def test_the_reward_is_progress_and_a_collision_costs():
    env = gymnasium.make("foresee/Corridor-v1", evaluate=True)
    env.reset(seed=0)
    rewards, ended = [], False
    while not ended:
        observed, reward, terminated, truncated, info = env.step(FULL_AHEAD)
        rewards.append(reward)
        ended = terminated or truncated
    assert info["outcome"] == "collided"
    assert terminated
    assert rewards[-1] < 0.5 - COLLISION
    # Before it drove ahead, at most as far along its way as it drove.
    assert 0 < sum(rewards[:-1]) <= 0.5 * 1.5 * info["time"] ** 2 + 0.5
    assert env.observation_space.contains(observed)


def test_a_car_that_stands_is_stuck():
    env = gymnasium.make("foresee/Corridor-v1", evaluate=True)
    env.reset(seed=0)
    for _ in range(100):
        _, reward, terminated, truncated, info = env.step(np.zeros(2, dtype=np.float32))
        assert reward == 0
        assert not terminated
        if truncated:
            break
    assert info["outcome"] == "stuck"


def test_it_evaluates_in_the_buildings_of_the_suite_and_learns_in_others():
    env = gymnasium.make("foresee/Office-v1", evaluate=True).unwrapped
    names = [env.reset()[1]["building"] for _ in range(2)]
    places = Suite.read("office-v1").places
    assert names == [f"office-{place.seed}" for place in places[:2]]
    assert env.reset(options={"building": 7})[1]["building"] == f"office-{places[7].seed}"
    learning = gymnasium.make("foresee/Office-v1").unwrapped
    seed = int(learning.reset(seed=3)[1]["building"].removeprefix("office-"))
    assert 200_000_000 <= seed < 700_000_000


def test_it_learns_in_as_many_buildings_as_asked_for(monkeypatch):
    drawn = []

    def generated(family, seed):
        drawn.append(seed)
        return generate(family, seed)

    monkeypatch.setattr(sim.gym_env, "generate", generated)
    monkeypatch.setattr(sim.gym_env, "_kept_task_in", cache(sim.gym_env._task_in))
    learning = gymnasium.make("foresee/Corridor-v1", buildings=2).unwrapped
    seen = [learning.reset(seed=seed)[1]["building"] for seed in range(8)]
    assert sorted(drawn) == [200_000_000, 200_000_001]
    assert set(seen) == {f"corridor-{seed}" for seed in drawn}
    for buildings in (0, -1):
        with pytest.raises(ValueError, match=f"buildings is {buildings}, it must be at least 1"):
            gymnasium.make("foresee/Corridor-v1", buildings=buildings)


def test_buildings_of_which_none_has_a_route_are_refused(monkeypatch):
    def no_task(*_):
        raise NoTaskError("no route")

    monkeypatch.setattr(sim.gym_env, "_kept_task_in", cache(sim.gym_env._task_in))
    monkeypatch.setattr(sim.gym_env, "task_in_world", no_task)
    with pytest.raises(NoTaskError, match="no building to learn in has a route: ask for more"):
        gymnasium.make("foresee/Corridor-v1", buildings=2).unwrapped.reset(seed=0)


def test_a_car_with_a_reverse_gear_backs_from_rest():
    env = gymnasium.make("foresee/Mixed-v1", evaluate=True).unwrapped
    env.reset(seed=0)
    observed = [env.step(np.array([drive, 0.0]))[0]["motion"][0] for drive in (-1.0, -1.0, 1.0)]
    assert observed[:2] == pytest.approx([-0.15, -0.3])
    # The other way brakes first.
    assert observed[2] == pytest.approx(-0.15)


def test_the_goal_is_shown_in_the_frame_of_the_car():
    env = gymnasium.make("foresee/Mixed-v1", evaluate=True).unwrapped
    motion = env.reset(seed=0)[0]["motion"]
    place = Suite.read("mixed-v1").places[0]
    yaw, away = place.start[2], np.subtract(place.goal, place.start[:2])
    assert motion[1:3] == pytest.approx([np.cos(yaw), np.sin(yaw)])
    turned = [[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]] @ away
    assert motion[3:5] == pytest.approx(turned, abs=1e-3)


def test_the_map_shows_free_and_occupied_cells():
    env = gymnasium.make("foresee/Corridor-v1", observe="map", evaluate=True)
    image = env.reset(seed=0)[0]["map"][0]
    assert image.shape == (100, 100)
    assert image[50, 50] == 0
    assert {0, 127, 255} == set(np.unique(image))


def test_an_unknown_observation_is_refused():
    with pytest.raises(ValueError, match="observe is 'camera', it must be of scan, map"):
        gymnasium.make("foresee/Corridor-v1", observe="camera")


@pytest.mark.parametrize(("name", "observe"), [("Corridor", "scan"), ("Mixed", "map")])
def test_an_agent_drives_in_the_race_as_in_the_environment(name, observe):
    def act(observed):
        """Head for the point ahead at 1 m/s."""
        speed, *_, x, y = observed["motion"]
        assert observe in observed
        return np.array([1.0 - speed, 1.6 * y / (x**2 + y**2)], dtype=np.float32)

    env = gymnasium.make(f"foresee/{name}-v1", observe=observe, evaluate=True).unwrapped
    observed, ended = env.reset(seed=0)[0], False
    while not ended:
        observed, _, terminated, truncated, info = env.step(act(observed))
        ended = terminated or truncated
    suite, task = env.suite, env.suite.task(0)
    prescribed = suite.route == "fixed"
    driver = ControllerDriver(as_driver(act, observe), task, suite.car, suite.window, prescribed)
    rng = np.random.default_rng(0)
    episode = run_episode(task, driver, DubinsCar(suite.car), Lidar(), EpisodeConfig(), rng)
    assert episode.time == pytest.approx(info["time"])
    assert episode.outcome == info["outcome"]
    assert episode.path_length > 5.0
