"""Many virtual reconstructions of the ACL, drawn at random: what laxity depends on.

    python -m bullet_tendon.scenarios.reconstruction_sweep --file cases.jsonl --picture trends.png

Each case draws both tunnels, the tension and the stiffness of the graft (reconstruction.PLAN), and is tested
at five angles: 90 N of drawer, and 5 N m of internal torque. Finished cases are lines of JSON in the file.
The same command goes on where it was ended. The table has the slopes of a linear fit by all variables
together, by the range from which each is drawn, with their standard errors.
"""

import argparse
import json
import os
import sys
import time

import numpy as np
from bullet_tendon.scenarios.reconstruction import ANGLES, PLAN, virtual_reconstruction

import bullet_tendon as bt
from bullet_tendon import errors

LABELS = {
    "deep": "femoral mouth, depth from the rear [-]",
    "low": "femoral mouth, height below the roof [-]",
    "forward": "tibial mouth, forwards [m]",
    "lateral": "tibial mouth, laterally [m]",
    "tension": "tension at fixation [N]",
    "slope": "stiffness of the graft [N]",
}
PANELS = (("tension", "drawer"), ("low", "rotation"), ("slope", "drawer"), ("deep", "drawer"))
LACHMAN, EXTENSION = ANGLES.index(30), ANGLES.index(0)
# Of which angle each measure is shown.
AT = {"drawer": LACHMAN, "rotation": EXTENSION}
UNITS = {"drawer": "drawer at 30 degrees [mm]", "rotation": "internal rotation at extension [degrees]"}


def main(arguments: list[str] | None = None) -> int:
    """The command line. Returns the exit status: 0, or 2 for bad usage."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=500, metavar="N")
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1, metavar="N")
    parser.add_argument("--file", metavar="FILE.jsonl", help="keeps finished cases, and goes on from them")
    parser.add_argument("--json", metavar="FILE", help="writes the fits to FILE")
    parser.add_argument("--picture", metavar="FILE.png", help="draws the trends (needs the extra `view`)")
    wanted = parser.parse_args(arguments)
    if wanted.cases < len(PLAN) + 2 or wanted.processes < 1:
        parser.error(f"at least {len(PLAN) + 2} cases, on at least one process")
    start = time.perf_counter()
    executor = wanted.processes if wanted.processes > 1 else None
    results = bt.sweep(
        virtual_reconstruction, [{}] * wanted.cases, executor=executor, seed=wanted.seed, file=wanted.file
    )
    seconds = time.perf_counter() - start
    record = {
        "cases": wanted.cases,
        "processes": wanted.processes,
        "seconds": seconds,
        "not_at_rest": sum(not result["at_rest"] for result in results),
        "fits": fits(results),
    }
    print("\n".join(table(record)))
    if wanted.json:
        with open(wanted.json, "w", encoding="utf-8") as file:
            json.dump(record, file, indent=2)
    try:
        if wanted.picture:
            draw(wanted.picture, results, record["fits"])
    except errors.MissingExtra as problem:
        parser.error(str(problem))
    return 0


def fits(results: list[dict]) -> dict:
    """By measure and variable: slope by the variable's whole range, and its standard error.

    Of the cases at rest, by least squares on all variables together. Also the mean, and what of the variance
    is explained.
    """
    rested = [result for result in results if result["at_rest"]]
    columns = [np.array([result[name] for result in rested]) for name in PLAN]
    shares = [column / (high - low) for column, (low, high) in zip(columns, PLAN.values(), strict=True)]
    matrix = np.stack([np.ones(len(rested)), *shares], axis=1)
    found = {}
    for measure, angle in AT.items():
        values = np.array([result[measure][angle] for result in rested])
        slopes, *_ = np.linalg.lstsq(matrix, values, rcond=None)
        missed = values - matrix @ slopes
        freedom = max(len(values) - matrix.shape[1], 1)
        covariance = missed @ missed / freedom * np.linalg.pinv(matrix.T @ matrix)
        errors_of = np.sqrt(np.diag(covariance))
        found[measure] = {
            "mean": float(values.mean()),
            "explained": float(1 - missed.var() / values.var()),
            "constant": float(slopes[0]),
            "slopes": dict(zip(PLAN, slopes[1:].tolist(), strict=True)),
            "errors": dict(zip(PLAN, errors_of[1:].tolist(), strict=True)),
        }
    return found


def table(record: dict) -> list[str]:
    lines = [
        f"{record['cases']} reconstructions in {record['seconds']:.0f} s on {record['processes']} processes, "
        f"{record['not_at_rest']} not at rest"
    ]
    for measure, fit in record["fits"].items():
        lines.append(f"{UNITS[measure]}: mean {fit['mean']:.2f}, {fit['explained']:.0%} explained")
        for name in PLAN:
            low, high = PLAN[name]
            lines.append(
                f"  from {low:g} to {high:g}: {fit['slopes'][name]:+7.2f} +- {fit['errors'][name]:.2f}   "
                f"{LABELS[name]}"
            )
    return lines


def draw(path: str, results: list[dict], fitted: dict) -> None:
    """Write a picture of the trends. Raises MissingExtra without matplotlib."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise errors.MissingExtra("matplotlib", "view", "drawing trends") from None
    rested = [result for result in results if result["at_rest"]]
    page = Figure(figsize=(11, 8), dpi=120, layout="constrained")
    page.suptitle(f"{len(rested)} virtual reconstructions of the ACL")
    for axes, (name, measure) in zip(page.subplots(2, 2).flat, PANELS, strict=True):
        x = np.array([result[name] for result in rested])
        y = np.array([result[measure][AT[measure]] for result in rested])
        other = "low" if name == "tension" else "tension"
        dots = axes.scatter(x, y, c=[result[other] for result in rested], s=9, cmap="viridis")
        page.colorbar(dots, ax=axes, label=LABELS[other])
        fit, span = fitted[measure], PLAN[name]
        slope = fit["slopes"][name] / (span[1] - span[0])
        ends = np.array(span)
        label = f"fit: {fit['slopes'][name]:+.2f} over the range"
        axes.plot(ends, y.mean() + slope * (ends - x.mean()), color="crimson", label=label)
        axes.set(xlabel=LABELS[name], ylabel=UNITS[measure])
        axes.grid(alpha=0.3)
        axes.legend()
    page.savefig(path, facecolor="white")


if __name__ == "__main__":
    sys.exit(main())
