"""The pytest plugin: simulators as fixtures, scenarios as markers or as tests, and what to look at when a test
fails."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, Optional

import pytest

from .control import ControlError
from .picture import draw
from .simulator import Simulator, connect, joinable, program, start

_FAILED: "pytest.StashKey[bool]" = pytest.StashKey()
_MAKER = "_rigsim_maker"
# Of a log, for a test that fails: the last lines, and of requests and replies few.
_MOST_LINES = 60
_MOST_TRAFFIC = 10
_MOST_COLUMNS = 140
_TRAFFIC = re.compile(r" *[\d.]+ \S+ (->|<-) ")


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("rigsim", "simulated vehicles")
    group.addoption(
        "--sim-set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="a setting of every simulator, as in r150.heartbeat_timeout=5s; may be repeated",
    )
    group.addoption("--sim-seed", type=int, metavar="N", help="the seed of every simulator [default: 1]")
    group.addoption("--sim-world", metavar="FILE", help="the world file of every simulator of one device")
    group.addoption(
        "--sim-speed", type=float, metavar="X", help="simulated seconds for each second of real time [default: 1]"
    )
    group.addoption(
        "--sim-keep",
        metavar="DIR",
        help="where to keep log, trace and picture of tests that fail [default: the test's own folder]",
    )


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers",
        "sim(settings={}, seed=None, world=None, speed=1.0): how the simulator of this test is started",
    )
    config.addinivalue_line(
        "markers",
        "scenario(file): the steps and faults of this scenario file happen to the test's simulator, "
        "and the test fails if its rules are broken",
    )


@pytest.hookimpl(trylast=True)
def pytest_runtest_call(item: pytest.Item) -> None:
    # The test itself has passed by now.
    maker: Optional[Maker] = getattr(item, _MAKER, None)
    if item.get_closest_marker("scenario") and not (maker and maker.made):
        pytest.fail("the scenario of this test happened to nothing: it uses no simulator, as sim_r150", pytrace=False)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: "pytest.CallInfo[None]") -> Iterator[None]:
    outcome: Any = yield
    report = outcome.get_result()
    if report.when != "teardown" and report.failed:
        item.stash[_FAILED] = True
    if report.when == "teardown" and item.stash.get(_FAILED, False):
        # Only now all of it is printed. The word is what pytest shows sections of this phase by.
        maker: Optional[Maker] = getattr(item, _MAKER, None)
        for number, simulator in enumerate(maker.made if maker else [], 1):
            lines = _shorten(simulator.log)
            if maker and number in maker.kept:
                lines.append(f"log, trace and picture: {maker.kept[number]}")
            if lines:
                report.sections.append(("simulator, to its teardown", "\n".join(lines)))


def _shorten(log: str) -> List[str]:
    """The end of a log, in which what happened is not lost among requests and replies."""
    lines = log.splitlines()
    traffic = [at for at, line in enumerate(lines) if _TRAFFIC.match(line)]
    passed_over = set(traffic[:-_MOST_TRAFFIC])
    shown = []
    count = 0
    for at, line in enumerate(lines):
        if at in passed_over:
            count += 1
            continue
        if count:
            shown.append(f"         ... requests and replies: {count}")
            count = 0
        shown.append(line if len(line) <= _MOST_COLUMNS else f"{line[:_MOST_COLUMNS]}...")
    return shown[-_MOST_LINES:]


class Maker:
    """Starts the simulators of a test, or joins the one that plays it."""

    def __init__(self, request: pytest.FixtureRequest, folder: Path) -> None:
        self._request = request
        self._folder = folder
        self.made: List[Simulator] = []
        # Devices that were asked for of a simulator that was joined.
        self._asked_for: List[str] = []
        #: Where log, trace and picture of those that failed are, by their number.
        self.kept: Dict[int, Path] = {}
        setattr(request.node, _MAKER, self)

    def __call__(self, device: Optional[str] = None, *, rig: "Optional[str | Path]" = None, **options: Any) -> Simulator:
        """A simulator of one device, an R150 unless named, or of a rig file. Under ``sim run`` it is the one that plays this
        test, if that is what the test asks for."""
        config = self._request.config
        marker = self._request.node.get_closest_marker("sim")
        asked: Dict[str, Dict[str, Any]] = {
            "the options of pytest": {
                "settings": dict(one.partition("=")[::2] for one in config.getoption("--sim-set")),
                "seed": config.getoption("--sim-seed"),
                "world": config.getoption("--sim-world"),
                "speed": config.getoption("--sim-speed"),
            },
            "its sim marker": dict(marker.kwargs) if marker else {},
            "its call of sim()": {**options, "rig": rig},
        }
        scenario = self._request.node.get_closest_marker("scenario")
        if joinable():
            return self._join(device, asked, scenario)
        chosen: Dict[str, Any] = {"settings": {}}
        for more in asked.values():
            settings = {**chosen["settings"], **(more.get("settings") or {})}
            chosen.update({key: value for key, value in more.items() if value is not None}, settings=settings)
        chosen.setdefault("seed", 1)
        if scenario is not None:
            own = [
                f"its own {key}"
                for key in ("rig", "world", "scenario")
                if asked["its call of sim()"].get(key) or asked["its sim marker"].get(key)
            ]
            if self.made:
                own.append("a second simulator")
            if own:
                why = f"its scenario marker names all devices and their world; it cannot have {' and '.join(own)}"
                pytest.fail(why, pytrace=False)
            chosen["scenario"] = _scenario_file(self._request, scenario)
            chosen.pop("world", None)
        elif "rig" in chosen and asked["the options of pytest"]["world"] == chosen.get("world"):
            # That is for simulators of one device.
            chosen.pop("world", None)
        folder = self._folder / f"sim{len(self.made) + 1}"
        folder.mkdir()
        simulator = start(device or "r150", folder=folder, trace=folder / "trace.jsonl", **chosen)
        self.made.append(simulator)
        if scenario is not None and device is not None:
            _want_kind(simulator, device)
        return simulator

    def _join(
        self, device: Optional[str], asked: Dict[str, Dict[str, Any]], scenario: Optional[pytest.Mark]
    ) -> Simulator:
        """The simulator of the `sim run` around this test, which has to be what was asked for."""
        simulator = connect()
        run = {"seed": simulator.control.state()["seed"]}
        if simulator.time == "real":
            run["speed"] = simulator.speed
        else:
            # Simulated time has no speed; a test cannot notice.
            for one in asked.values():
                one.pop("speed", None)
        refused = [
            f"{key} {value!r} ({by})"
            for by, one in asked.items()
            for key, value in one.items()
            if value is not None and value != {} and run.get(key, run) != value
        ]
        if scenario is not None:
            refused.append(f"scenario {', '.join(map(str, scenario.args))} (its scenario marker)")
        if refused:
            pytest.fail(
                f"this test asks for {' and '.join(refused)}, and cannot have it: it runs inside `sim run`, which "
                "has its own scenario. Run it with pytest alone, or put what it asks for into that scenario",
                pytrace=False,
            )
        if device is not None:
            _want_kind(simulator, device, self._asked_for.count(device))
            self._asked_for.append(device)
        self.made.append(simulator)
        return simulator

    def finish(self) -> None:
        """Ends what was started here, and mends what was broken in what was joined."""
        failed = self._request.node.stash.get(_FAILED, False)
        verdicts, skipped = [], []
        self._worlds: Dict[int, Any] = {}
        for number, simulator in enumerate(self.made, 1):
            if simulator.joined:
                try:
                    simulator.clear()
                except ControlError:
                    # It ended with the scenario.
                    pass
                continue
            if failed:
                try:
                    self._worlds[number] = simulator.control.state()
                except ControlError:
                    # It is gone already; its trace is there.
                    pass
            # Whatever else it ends with, it has not passed.
            if simulator.close() != 0:
                verdicts.append(simulator.verdict or simulator.log)
            elif simulator.verdict:
                skipped.append(simulator.verdict)
            if failed or verdicts:
                self._keep(simulator, number)
        if verdicts and not failed:
            pytest.fail("\n".join(verdicts), pytrace=False)
        if skipped and not failed:
            pytest.skip("\n".join(skipped))

    def _keep(self, simulator: Simulator, number: int) -> None:
        """Log, trace and picture of a test that failed."""
        own = simulator.folder
        if own is None:
            return
        draw(own / "trace.jsonl", self._worlds.get(number), own / "picture.svg")
        self.kept[number] = _keep_files(self._request, own, f"sim{number}-")


def _want_kind(simulator: Simulator, kind: str, taken: int = 0) -> None:
    """Fails a test whose scenario does not have one more device of a kind than those that are taken."""
    kinds = [device.kind for device in simulator.devices.values()]
    if kinds.count(kind) <= taken:
        pytest.fail(
            f"the scenario has no {'further ' if taken else ''}{kind} for this test; it has {', '.join(kinds)}", pytrace=False
        )


def _keep_files(request: pytest.FixtureRequest, folder: Path, before: str = "") -> Path:
    """Copies the files of a folder to where this test keeps them, if it keeps any; returns their folder."""
    keep = request.config.getoption("--sim-keep")
    if keep is None or not folder.is_dir():
        return folder
    name = "".join(c if c.isalnum() or c in "-_." else "_" for c in request.node.nodeid)
    place = Path(keep) / name
    place.mkdir(parents=True, exist_ok=True)
    for path in folder.iterdir():
        if path.is_file() and not path.is_symlink():
            shutil.copy(path, place / f"{before}{path.name}")
    return place


def _scenario_file(request: pytest.FixtureRequest, marker: pytest.Mark) -> Path:
    """The file that a marker names: beside the test, or from where pytest was started."""
    if len(marker.args) != 1:
        pytest.fail("a scenario marker names one file", pytrace=False)
    beside: Path = request.path.parent / str(marker.args[0])
    found: Path = beside if beside.exists() else request.config.rootpath / str(marker.args[0])
    if not found.exists():
        pytest.fail(f"there is no scenario {marker.args[0]}, neither beside the test nor in the root folder", pytrace=False)
    return found


@pytest.fixture
def sim(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Callable[..., Simulator]]:
    """Makes simulators: ``sim("mecanum", settings={...})``, ``sim(rig="worlds/two-and-two.toml")``."""
    maker = Maker(request, tmp_path)
    yield maker
    maker.finish()


@pytest.fixture
def sim_r150(sim: Callable[..., Simulator]) -> Simulator:
    """An R150."""
    return sim("r150")


@pytest.fixture
def sim_mecanum(sim: Callable[..., Simulator]) -> Simulator:
    """A mecanum car."""
    return sim("mecanum")


@pytest.fixture
def sim_play(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[..., None]:
    """Plays a scenario with a client, in the simulator's time: ``sim_play("cable.toml", "python3", "client.py")``.
    The test fails with what ``sim run`` says."""

    def play(scenario: "str | Path", *client: "str | Path") -> None:
        seed = request.config.getoption("--sim-seed")
        results = tmp_path / "results"
        command = [program(), "run", "--seed", str(1 if seed is None else seed), "--output", str(results)]
        command += [str(scenario), *(["--", *map(str, client)] if client else [])]
        ended = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True)
        if ended.returncode != 0:
            place = _keep_files(request, results)
            pytest.fail(f"{ended.stdout}{ended.stderr}traces: {place}", pytrace=False)

    return play
