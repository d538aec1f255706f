"""Learn to drive with PPO of stable-baselines3, and enter the race with what was learned.

    pip install 'foresee-nav[gym]' stable-baselines3
    python examples/learn.py 200000
    foresee bench --suite corridor-v1 --driver examples.learn:Learned --out learned.json

200 000 ticks take minutes to hours, and are few for a good driver.
"""

import sys

import gymnasium
from stable_baselines3 import PPO

import foresee.gym  # noqa: F401  Registers the environments.
from sim.gym_env import as_driver

WEIGHTS = "learned.zip"
"""File of the learned policy, in the working folder."""


def learn(ticks):
    """Learn for a number of ticks, and save the policy."""
    policy = PPO("MultiInputPolicy", gymnasium.make("foresee/Corridor-v1"), verbose=1)
    policy.learn(ticks)
    policy.save(WEIGHTS)


def Learned(mission):
    """Return a driver that does what the learned policy does."""
    # The file is unpickled, which runs code: load none of somebody else.
    policy = PPO.load(WEIGHTS)
    return as_driver(lambda observed: policy.predict(observed, deterministic=True)[0])(mission)


if __name__ == "__main__":
    learn(int(sys.argv[1]))
