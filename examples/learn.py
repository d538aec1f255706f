"""Learn to drive with PPO of stable-baselines3, and enter the race with what was learned.

pip install 'foresee-nav[rl]'
python -m examples.learn
foresee bench --suite corridor-v1 --size small --driver examples.learn:Learned --out ppo.json
"""

import argparse
from functools import cache
from pathlib import Path

import gymnasium
import torch
from safetensors.torch import load_model, save_model
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import VecNormalize
from stable_baselines3.ppo import MultiInputPolicy

from foresee.infra.atomic_file import replacing
from sim.gym_env import as_driver

WEIGHTS = Path("learned.safetensors")
"""File of the learned policy, in the working folder."""
MOTION, SCAN = (4.0, 1.0, 1.0, 20.0, 20.0, 3.0, 3.0), 2.5
"""Typical values of the parts of an observation, see `sim.gym_env.DriveEnv`."""


class Features(BaseFeaturesExtractor):
    """The observation as one vector with values in [-1, 1]."""

    def __init__(self, space):
        super().__init__(space, sum(part.shape[0] for part in space.values()))

    def forward(self, observed):
        """Return the features (B, n)."""
        motion, scan = observed["motion"], observed["scan"]
        return torch.cat([torch.tanh(motion / motion.new_tensor(MOTION)), scan / SCAN], dim=1)


POLICY = {"features_extractor_class": Features, "log_std_init": -1.0}


def environment(**more):
    """Return the environment to learn in."""
    return gymnasium.make("foresee.gym:foresee/Corridor-v1", **more)


def learn(steps, seed, cars, buildings):
    """Learn for a number of steps of all cars together, and write the policy to `WEIGHTS`."""
    torch.set_num_threads(1)  # The network is too small for more.
    # In one process: a tick takes less time than to send what was observed to another.
    envs = make_vec_env(environment, cars, seed, env_kwargs={"buildings": buildings})
    ppo = PPO(
        "MultiInputPolicy",
        VecNormalize(envs, norm_obs=False),
        n_steps=512,
        batch_size=256,
        policy_kwargs=POLICY,
        seed=seed,
        verbose=1,
    )
    ppo.learn(steps)
    envs.close()
    # As safetensors, which contain no code: the file of `PPO.save` is unpickled.
    with replacing(WEIGHTS) as file:
        save_model(ppo.policy, file)


@cache
def learned():
    """Return the policy that was learned."""
    spaces = environment()
    policy = MultiInputPolicy(
        spaces.observation_space, spaces.action_space, lambda _: 0.0, **POLICY
    )
    load_model(policy, WEIGHTS)
    return policy


def act(observed):
    """Return the action of the policy without exploration."""
    return learned().predict(observed, deterministic=True)[0]


class Learned(as_driver(act)):
    """A driver of the race that does what the policy does."""

    weights = WEIGHTS


def main(argv=None):
    """Learn with the options of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=400_000, help="steps of all cars together")
    parser.add_argument("--seed", type=int, default=0, help="seed of buildings and of the policy")
    parser.add_argument("--cars", type=int, default=4, help="cars that drive at the same time")
    parser.add_argument("--buildings", type=int, default=50, help="buildings to learn in")
    options = parser.parse_args(argv)
    learn(options.steps, options.seed, options.cars, options.buildings)


if __name__ == "__main__":
    main()
