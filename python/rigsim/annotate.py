"""Shows failed scenarios on the lines of their files, in a pull request or a merge request.

    python -m rigsim.annotate results/junit.xml                       annotations of GitHub, on standard output
    python -m rigsim.annotate --gitlab quality.json results/junit.xml a code quality report of GitLab

With `--check FILE`, what `sim check` printed into a file is shown, too; the JUnit file need not be there then.
The line is the first one that contains the rule which failed; else that of the scenario's title.
"""

import argparse
import hashlib
import json
import re
import sys
import xml.etree.ElementTree as xml
from pathlib import Path
from typing import Iterable, List, NamedTuple


class Annotation(NamedTuple):
    """A failure or an error, and where it belongs."""

    file: str
    line: int
    title: str
    message: str


def line_of(lines: List[str], title: str, message: str) -> int:
    """The line of a scenario that a message belongs to, from 1."""
    # A message names its rule in backticks, and begins with the file's words for it, behind the time.
    words = re.sub(r'^[\d.]+ s(, "[^"]*")?: ', "", message).split(": ")[0]
    for wanted in [*re.findall(r"`([^`]+)`", message), words, title]:
        for number, line in enumerate(lines, 1):
            if wanted and wanted in line and not line.lstrip().startswith("#"):
                return number
    return 1


def annotations(junit: Path) -> Iterable[Annotation]:
    """Every failure and error of a JUnit file of `sim run --junit`."""
    for suite in xml.parse(junit).getroot().iter("testsuite"):
        file = suite.get("name", "")
        text = Path(file).read_text(encoding="utf-8") if Path(file).is_file() else ""
        for case in suite.iter("testcase"):
            for problem in [*case.iter("failure"), *case.iter("error")]:
                title, message = case.get("name", ""), problem.get("message", "")
                yield Annotation(file, line_of(text.splitlines(), title, message), title, message)


def mistakes(printed: str) -> Iterable[Annotation]:
    """Every mistake that `sim check` printed."""
    for file, line, message in re.findall(r"^(?:error: )?([^ :]+\.toml):(\d+):\d+: (.*)$", printed, re.MULTILINE):
        yield Annotation(file, int(line), "sim check", message)


def github(one: Annotation) -> str:
    """A workflow command, with its own escapes."""

    def escaped(text: str, more: str = "") -> str:
        return "".join(f"%{ord(letter):02X}" if letter in "%\r\n" + more else letter for letter in text)

    place = f"file={escaped(one.file, ':,')},line={one.line},title={escaped(one.title, ':,')}"
    return f"::error {place}::{escaped(one.message)}"


def gitlab(one: Annotation) -> object:
    """An entry of a code quality report."""
    # The time at which a rule broke is not part of what the failure is.
    same = f"{one.file} {one.title} {re.sub(r'[0-9.]+', '', one.message)}"
    return {
        "description": f"{one.title}: {one.message}",
        "check_name": "sim",
        "fingerprint": hashlib.sha256(same.encode()).hexdigest(),
        "severity": "major",
        "location": {"path": one.file, "lines": {"begin": one.line}},
    }


def main() -> None:
    options = argparse.ArgumentParser(prog="python -m rigsim.annotate", description=(__doc__ or "").split("\n")[0])
    options.add_argument("junit", type=Path, help="the file that `sim run --junit` wrote")
    options.add_argument("--gitlab", type=Path, metavar="FILE", help="write a code quality report into FILE")
    options.add_argument("--check", type=Path, metavar="FILE", help="show what `sim check` printed into FILE, too")
    given = options.parse_args()
    try:
        found = list(mistakes(given.check.read_text(encoding="utf-8"))) if given.check else []
        if given.junit.exists() or not given.check:
            found += annotations(given.junit)
    except (OSError, xml.ParseError) as error:
        sys.exit(f"error: {given.junit}: {error}")
    if given.gitlab:
        given.gitlab.write_text(json.dumps([gitlab(one) for one in found], indent=1) + "\n", encoding="utf-8")
    else:
        for one in found:
            print(github(one))


if __name__ == "__main__":
    main()
