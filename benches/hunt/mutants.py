#!/usr/bin/env python3
"""Mutants of a careful client: its error handling is damaged in one place, mechanically, and `sim hunt` looks for it.

    benches/hunt/mutants.py SIM r150|car [--runs N] [--every N] [--list]

A mutant loses what one `raise`, `except` or guard does, or one operand of `and` or `or`; or it has a number in a
guard that is ten times as large or a tenth. Only those that pass the plain job count. The unchanged client is the
reference, so that a finding is one of the mutant alone. `--list` plays the plain job only; `--every 5` hunts every
fifth.
"""
import argparse
import ast
import copy
import json
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
CLIENTS = {
    "r150": ("careful_client", "scenarios/r150/jobs/camera-drive.toml", "docs/examples/rules/r150.toml"),
    "car": ("careful_car_client", "scenarios/mecanum/jobs/rectangle.toml", "docs/examples/rules/car.toml"),
}
LEAVES = (ast.Raise, ast.Return, ast.Break, ast.Continue)


def places(tree):
    """What may be changed: a name for it, and what changes it in a tree like this one."""
    for at, node in enumerate(ast.walk(tree)):
        line = getattr(node, "lineno", 0)
        if isinstance(node, ast.ExceptHandler):
            yield f"line {line}: except does nothing", at, lambda node: setattr(node, "body", [ast.Pass()])
        if isinstance(node, ast.If) and any(isinstance(one, LEAVES) for one in node.body):
            yield f"line {line}: guard is never true", at, lambda node: setattr(node, "test", ast.Constant(False))
        if isinstance(node, ast.If) and isinstance(node.body[0], ast.Raise):
            yield f"line {line}: nothing is raised", at, lambda node: node.body.__setitem__(0, ast.Pass())
        if isinstance(node, ast.BoolOp):
            for place in range(len(node.values)):
                change = lambda node, place=place: node.values.pop(place)
                yield f"line {line}: operand {place + 1} is left out", at, change
        if isinstance(node, ast.Compare):
            for place, right in enumerate(node.comparators):
                if isinstance(right, ast.Constant) and isinstance(right.value, (int, float)) and right.value:
                    for factor in (10, 0.1):
                        change = lambda node, place=place, factor=factor: node.comparators.__setitem__(
                            place, ast.Constant(node.comparators[place].value * factor)
                        )
                        yield f"line {line}: {right.value} times {factor}", at, change
            if len(node.ops) == 1 and isinstance(node.ops[0], (ast.Lt, ast.Gt)):
                other = {ast.Lt: ast.GtE, ast.Gt: ast.LtE}[type(node.ops[0])]
                yield f"line {line}: comparison turned", at, lambda node, other=other: setattr(node, "ops", [other()])


def mutants(text):
    tree = ast.parse(text)
    for name, at, change in places(tree):
        mutant = copy.deepcopy(tree)
        change(list(ast.walk(mutant))[at])
        yield name, ast.unparse(ast.fix_missing_locations(mutant))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sim", type=Path)
    parser.add_argument("client", choices=CLIENTS)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--list", action="store_true")
    options = parser.parse_args()
    name, job, rules = CLIENTS[options.client]
    careful = ROOT / f"docs/examples/{name}.py"
    sim, job, rules = str(options.sim.resolve()), str(ROOT / job), str(ROOT / rules)
    made = passed = hunted = found = 0
    with tempfile.TemporaryDirectory() as folder:
        for what, text in mutants(careful.read_text()):
            made += 1
            mutant = Path(folder, f"mutant{made}.py")
            mutant.write_text(text)
            client = ["--", "python3", str(mutant)]
            plain = subprocess.run([sim, "run", "--seed", "1", job, *client], capture_output=True, check=False)
            if plain.returncode != 0:
                continue
            passed += 1
            if options.list or passed % options.every:
                continue
            hunted += 1
            output = Path(folder, f"found{made}")
            command = [sim, "hunt", "--runs", str(options.runs), "--fail-fast", "--shrink-runs", "40", "--rules", rules]
            command += ["--reference", f"exec python3 {careful}", "--output", str(output), job, *client]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode not in (0, 1):
                print(f"{what}: {done.stderr.strip()}", flush=True)
                continue
            findings = json.loads((output / "hunt.json").read_text())["jobs"][0]["findings"]
            found += bool(findings)
            about = findings[0]["rule"] + ": " + "; ".join(findings[0]["faults"]) if findings else "not found"
            print(f"{what}: {about}", flush=True)
    print(f"{made} mutants of {name}, {passed} pass the plain job, {hunted} hunted, {found} found")


if __name__ == "__main__":
    main()
