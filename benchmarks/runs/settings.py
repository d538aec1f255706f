"""The settings of a comparison, and the command line that is built from them."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

from predictor.infra.command_line import OneLineParser, UsageError

FAMILIES = ("corridor", "narrow", "office", "trap", "paper")
"""`sim.families.FAMILIES`, whose import takes longer than a --help may."""
VEHICLES = {"dubins": 0.0, "reeds-shepp": 0.5}
"""The cars, and how fast each reverses [m/s]; 0: it has no reverse gear."""
ARM_NAMES = ("known", "known+route", "predicted", "optimistic", "oracle", "full")


@dataclass(frozen=True)
class Settings:
    """All that decides the numbers of a run.

    Attributes:
        world: families of generated worlds, map_server files, folders of them.
        route: "free", or "fixed": the full-map way is given to all arms as the task.
        episodes: paired over the arms.
        seed: of the first episode; the others count on from it.
        arms: compared.
        predictor: a name, `package.module:Class`, or the path of a .safetensors file.
        risk: ε in [0, 1].
        v_max: top speed [m/s].
        window: side of the square that the LIDAR writes into [m].
        expansion: predicted square over window.
        noise: standard deviation of the LIDAR's ranges [m].
        dropout: share of its beams that say nothing.
        vehicle: "dubins" (forward only) or "reeds-shepp" (with a reverse gear).
    """

    world: tuple[str, ...] = ("corridor",)
    route: str = "free"
    episodes: int = 12
    seed: int = 0
    arms: tuple[str, ...] = ("known", "predicted", "oracle")
    predictor: str = "compact"
    risk: float = 0.05
    v_max: float = 4.0
    window: float = 5.0
    expansion: float = 2.0
    noise: float = 0.0
    dropout: float = 0.0
    vehicle: str = "dubins"

    def __post_init__(self) -> None:
        for arm in self.arms:
            if arm not in ARM_NAMES:
                raise UsageError(f"no arm is called {arm!r}; there are {', '.join(ARM_NAMES)}")
        if len(set(self.arms)) < len(self.arms) or not self.arms:
            raise UsageError("--arms wants each arm once, and at least one")
        if self.vehicle not in VEHICLES:
            raise UsageError(f"no vehicle is called {self.vehicle!r}; there are "
                             f"{', '.join(VEHICLES)}")  # fmt: skip
        bounds = {
            "episodes": (1, 1_000_000), "seed": (0, 2**31), "risk": (0, 1), "v_max": (0.5, 10),
            "window": (1, 100), "expansion": (1, 4), "noise": (0, 0.5), "dropout": (0, 0.95),
        }  # fmt: skip
        for name, (low, high) in bounds.items():
            value = getattr(self, name)
            if not low <= value <= high:
                flag = name.replace("_", "-")
                raise UsageError(f"--{flag} is {value}, it must lie between {low} and {high}")


@dataclass(frozen=True)
class Place:
    """Where a run is worked on and kept; none of it decides a number.

    Attributes:
        out: folder of results and figures.
        jobs: processes.
        dask: address of a Dask scheduler whose workers drive in their place, or None.
        baselines: folder of an earlier run: what would be driven the same is taken over.
        optimum: file of `benchmarks.optimum` whose T_opt times are compared with, or None.
    """

    out: Path
    jobs: int
    dask: str | None
    baselines: Path | None
    optimum: Path | None


def parse(argv: list[str] | None) -> tuple[Settings, Place]:
    """What to drive, and where, from a command line.

    Raises:
        UsageError: if a value cannot be used.
    """
    default = Settings()
    parser = OneLineParser(
        prog="benchmarks.corridor",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
        description="Drive a car through buildings that it has never seen, with and without a "
        "predicted map, and show who was faster and who collided. Interrupted runs go on from "
        "where they were: give the same command again.",
    )
    add = parser.add_argument
    add("--world", nargs="+", default=list(default.world), metavar="W",
        help=f"family of generated worlds ({', '.join(FAMILIES)}), map_server .yaml, or folder of "
        "them; several are taken in turn")  # fmt: skip
    add("--route", choices=("free", "fixed"), default=default.route,
        help="free: each arm finds its way; fixed: the full-map way is the task")  # fmt: skip
    add("--episodes", type=int, default=default.episodes, metavar="N", help="paired over the arms")
    add("--seed", type=int, default=default.seed, metavar="N", help="of the first episode")
    add("--arms", default=",".join(default.arms), metavar="A,B",
        help=f"compared: of {', '.join(ARM_NAMES)}, or all")  # fmt: skip
    add("--predictor", default=default.predictor, metavar="P",
        help="none, extend, compact, a name that a package offers, module:Class, or weights that "
        "predictor.train has written, FILE.safetensors")  # fmt: skip
    add("--risk", type=float, default=default.risk, metavar="ε",
        help="0: rely on what was seen free alone; 1: on all not seen occupied")  # fmt: skip
    add("--v-max", type=float, default=default.v_max, metavar="V", help="top speed [m/s]")
    add("--window", type=float, default=default.window, metavar="M",
        help="side of the square around the car in which the LIDAR is used [m]")  # fmt: skip
    add("--expansion", type=float, default=default.expansion, metavar="X",
        help="width of the predicted square over that of the window; no wider than a car can make "
        "use of: 10 m, or 14 m at 4 m/s")  # fmt: skip
    add("--noise", type=float, default=default.noise, metavar="M",
        help="standard deviation of the LIDAR's ranges [m]")  # fmt: skip
    add("--dropout", type=float, default=default.dropout, metavar="P",
        help="share of the LIDAR's beams that say nothing")  # fmt: skip
    add("--vehicle", choices=tuple(VEHICLES), default=default.vehicle,
        help="dubins: forward only; reeds-shepp: with a reverse gear, at most "
        f"{VEHICLES['reeds-shepp']:g} m/s")  # fmt: skip
    parser.add_jobs()
    add("--dask", metavar="ADDRESS", help="of a Dask scheduler, such as tcp://10.0.0.1:8786: its "
        "workers drive, in place of processes here")  # fmt: skip
    add("--baselines", type=Path, metavar="DIR", help="an earlier run with another predictor, "
        "ε or expansion: drives that would be the same (known, optimistic, full; with the same ε "
        "and expansion oracle) are taken from there")  # fmt: skip
    add("--optimum", type=Path, metavar="FILE", help="least times T_opt of the same tasks, from "
        "benchmarks.optimum, for the same top speed: adds them to the results")  # fmt: skip
    add("--out", type=Path, default=Path("results/corridor"), metavar="DIR",
        help="results.json, traces.npz and the figures go here")  # fmt: skip
    args = parser.parse_args(argv)
    arms = ARM_NAMES if args.arms == "all" else tuple(args.arms.split(","))
    settings = Settings(
        tuple(args.world), args.route, args.episodes, args.seed, arms, args.predictor, args.risk,
        args.v_max, args.window, args.expansion, args.noise, args.dropout,
        args.vehicle,
    )  # fmt: skip
    if args.optimum is not None and settings.vehicle != "dubins":
        raise UsageError("--optimum: its times are those of the dubins car")
    return settings, Place(args.out, args.jobs, args.dask, args.baselines, args.optimum)
