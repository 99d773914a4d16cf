#!/usr/bin/env python3
"""The bench of `sim hunt`: how many runs it takes to find the bugs of bugs.toml.

    benches/hunt/bench.py SIM [NAME...] [--half development|held-out|all] [--seeds N] [--runs N] [--stages STAGES]
                          [--results FILE]

Needs a C compiler. Every bug is seeded in a client that is careful otherwise, and that client is the reference: a
finding counts where the client with the bug breaks a rule that the one without it keeps. `--stages random` is
the baseline: random schedules of the same space. Prints a line for each bug and seed, and a table by class. Every bug
is hunted with one seed before any with the next; after `--minutes` no hunt begins, and the table is of those before.
With `--results`, each result is added to the file, and what is there already is not hunted again: hundreds of hunts take
days. The file is to be removed when the search has changed. results.jsonl is that of docs/performance.md, with
`--shrink-runs 1`. Its rows that begin with uniform, moments, margins or reactions are of builds without a part of it.
"""
import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).resolve().parent


def fits(kinds, noted):
    """Whether each kind is one of those noted for its own fault."""
    if len(kinds) != len(noted):
        return False
    if not kinds:
        return True
    places = [at for at, some in enumerate(noted) if kinds[0] in some]
    return any(fits(kinds[1:], noted[:at] + noted[at + 1 :]) for at in places)


def hunt(options, folder, bug, seed):
    """Hunts one bug in time; returns the run of its finding or None, and whether that is as small as noted."""
    key = [options.stages or "all", bug["client"], bug["name"], seed, options.runs]
    if str(key) in options.known:
        return options.known[str(key)]
    if time.monotonic() > options.until:
        return None
    result = hunted(options, folder, bug, seed)
    if options.results:
        with options.results.open("a") as file:
            file.write(json.dumps(key + list(result)) + "\n")
    return result


def hunted(options, folder, bug, seed):
    """The same of one that is not known."""
    client, output = folder / bug["client"], folder / f"{bug['client']}-{bug['name']}-{seed}"
    command = [options.sim, "hunt", "--runs", str(options.runs), "--seed", str(seed), "-j", "1", "--fail-fast"]
    command += ["--shrink-runs", str(options.shrink_runs), "--reference", f"exec {client} none", "--output", output]
    command += ["--stages", options.stages] if options.stages else []
    command += [HERE / f"{bug['client']}.toml", "--", client, bug["name"]]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        sys.exit(f"{bug['name']}: {done.stderr}")
    job = json.loads((output / "hunt.json").read_text())["jobs"][0]
    found = [one for one in job["findings"] if one["file"]]
    if not found:
        print(f"{bug['client']:5} {bug['class']:9} {bug['name']:34} seed {seed}: not in {job['runs']} runs", flush=True)
        return None, False
    first = found[0]
    small = fits([fault.split(" ")[0] for fault in first["faults"]], bug["faults"])
    about = "; ".join(first["faults"]) + ("" if small else "  [not the noted minimum]")
    print(f"{bug['client']:5} {bug['class']:9} {bug['name']:34} seed {seed}: run {first['run']}: {about}", flush=True)
    return first["run"], small


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sim", type=Path)
    parser.add_argument("names", nargs="*", help="only these bugs")
    parser.add_argument("--half", default="development", choices=["development", "held-out", "all"])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--shrink-runs", type=int, default=300)
    parser.add_argument("--stages")
    parser.add_argument("--minutes", type=float, default=float("inf"))
    parser.add_argument("--at-once", type=int, default=2)
    parser.add_argument("--results", type=Path)
    options = parser.parse_args()
    lines = options.results.read_text().splitlines() if options.results and options.results.exists() else []
    options.known = {str(line[:-2]): tuple(line[-2:]) for line in map(json.loads, lines)}
    options.sim = options.sim.resolve()
    options.until = time.monotonic() + 60 * options.minutes
    bugs = tomllib.loads((HERE / "bugs.toml").read_text())["bug"]
    bugs = [bug for bug in bugs if options.half == "all" or bug["held_out"] == (options.half == "held-out")]
    bugs = [bug for bug in bugs if not options.names or bug["name"] in options.names]
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(options.at_once) as pool:
        for client in ("r150", "car"):
            out = ["-o", str(Path(folder, client)), str(HERE / f"{client}.c"), "-lm"]
            subprocess.run(["cc", "-O1", "-Wall", "-Wextra", "-Werror", "-static", *out], check=True)
        cases = [(bug, seed) for seed in range(1, options.seeds + 1) for bug in bugs]
        results = list(pool.map(lambda case: hunt(options, Path(folder), *case), cases))
    cases, results = zip(*[(case, result) for case, result in zip(cases, results) if result])
    print(f"{len(cases)} of {len(bugs) * options.seeds} hunts")
    print("\n| class | found | runs until found: median (quartiles) | noted minimum |\n|---|---|---|---|")
    for name in ("any", "window", "parameter", "two"):
        own = [result for (bug, _), result in zip(cases, results) if bug["class"] == name]
        if not own:
            continue
        runs = [run or options.runs + 1 for run, _ in own]
        found = [small for run, small in own if run]
        low, middle, high = statistics.quantiles(runs, n=4, method="inclusive") if len(runs) > 1 else runs * 3
        show = lambda runs: f"{runs:.0f}" if runs <= options.runs else f"> {options.runs}"
        print(
            f"| {name} | {len(found)} of {len(own)} | {show(middle)} ({show(low)} to {show(high)}) "
            f"| {sum(found)} of {len(found)} |"
        )


if __name__ == "__main__":
    main()
