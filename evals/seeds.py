"""Run one scene with many seeds: task families, acceptance, and the share of runs that needed a fix."""

from collections.abc import Sequence
from pathlib import Path

from grs_agents import content
from grs_agents.runs import Job, make_experiment_parser, positive_int, run_experiment, settings_as_arguments


def main(arguments: Sequence[str]) -> int:
    """Run one scene with seeds 0, 1, 2, ...

    Returns:
        0 if every seed came to a verdict, 1 if not.
    """
    sample = content.content_path("assets", "scenes") / "groceries"
    parser = make_experiment_parser("seeds", __doc__)
    parser.add_argument("scene", type=Path, nargs="?", default=sample, help="a scene folder; the sample by default")
    parser.add_argument("--seeds", type=positive_int, default=20, help="how many seeds, from 0")
    options = parser.parse_args(arguments)
    jobs = [
        Job(
            f"seed {seed}",
            options.scene,
            options.out / f"seed_{seed:03d}",
            ("--seed", str(seed), *settings_as_arguments(options)),
        )
        for seed in range(options.seeds)
    ]
    return run_experiment(jobs, options)
