"""Starting, finding and using simulators."""

from __future__ import annotations

import atexit
import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Dict, Iterator, List, Mapping, Optional, Sequence, Type, Union

from .control import Control, ControlError, Event, NotReached, Value

Json = Any
PathLike = Union[str, "os.PathLike[str]"]
Seconds = Union[str, float]

_READY_WITHIN = 60.0
_END_WITHIN = 30.0
_REST_WITHIN = 120.0
# How often it is looked whether a scenario has begun.
_LOOKS = 50


def program() -> str:
    """The path of ``sim``: ``$SIM_PROGRAM``, the one of this package, or the one on the path."""
    named = os.environ.get("SIM_PROGRAM")
    if named:
        return named
    for folder in (sysconfig.get_path("scripts"), str(Path(sys.executable).parent)):
        own = Path(folder) / "sim"
        if own.is_file():
            return str(own)
    found = shutil.which("sim")
    if found is None:
        raise FileNotFoundError("there is no program `sim`: install the wheel, or set SIM_PROGRAM")
    return found


def scenarios(*places: PathLike, tag: Optional[str] = None) -> List[str]:
    """The scenario files in files and folders, as ``sim run --list`` has them; with a tag, those alone."""
    command = [program(), "run", "--list", *(["--tag", tag] if tag else []), *map(str, places)]
    listed = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    if listed.returncode != 0:
        raise ValueError(listed.stderr.strip())
    return [line.split(": ")[0] for line in listed.stdout.splitlines()]


def span(value: Seconds) -> str:
    """A time as files have it; plain numbers are seconds."""
    return value if isinstance(value, str) else f"{value!r} s"


class Step:
    """A step that was added, such as a fault or a push. As a context manager it is reverted at the end of the
    block."""

    def __init__(self, control: Control, name: str) -> None:
        self._control = control
        self.name = name

    @property
    def state(self) -> Dict[str, Json]:
        """Its state: ``state`` is waiting, active, done or failed."""
        state: Dict[str, Json] = self._control.step(self.name)
        return state

    @property
    def hits(self) -> int:
        """How often its fault has hit something so far."""
        return int(self.state["hits"])

    def clear(self) -> None:
        """Cancels it, and reverts what it changed."""
        self._control.clear(self.name)

    def __enter__(self) -> "Step":
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        try:
            self.clear()
        except ControlError:
            # The error of the block is raised, not that the simulator no longer answers.
            if error is None:
                raise


class Device:
    """A device of a simulator."""

    def __init__(self, simulator: "Simulator", about: Mapping[str, Json], alone: bool) -> None:
        self.simulator = simulator
        self.name: str = about["name"]
        self.kind: str = about["kind"]
        self._prefix = "" if alone else f"{about['identifier']}."
        self._ports: List[Dict[str, Json]] = about["ports"]

    @property
    def control(self) -> Control:
        """The calls of control."""
        return self.simulator.control

    @property
    def port(self) -> str:
        """The path of its port: open it as any serial port."""
        return str(self._ports[0]["path"])

    @property
    def ports(self) -> Dict[str, str]:
        """The paths of all its links, by their names."""
        return {port["link"]: port["path"] for port in self._ports}

    def get(self, name: str) -> Value:
        """The value of a name of ``sim names`` now, as ``truth.speed_mps``."""
        full = self._prefix + name
        return self.control.values([full])[full]

    def until(self, condition: str, within: Seconds = "5 s", message: Optional[str] = None) -> None:
        """Waits until a condition holds, ``within`` simulated time; with several devices, names in it
        begin with a device's. Raises :class:`NotReached`."""
        __tracebackhide__ = True
        self.simulator.until(condition, within, message)

    def fault(self, kind: str, lasts: Optional[Seconds] = None, **parameters: Json) -> Step:
        """Breaks something: a fault of ``sim faults`` with its parameters."""
        named = {name.rstrip("_"): value for name, value in parameters.items()}
        return self.step({"fault": {"kind": kind, **named}}, lasts)

    def operator(self, action: str, value: Json = None, lasts: Optional[Seconds] = None) -> Step:
        """Applies an action of an operator, as ``operator("emergency_stop", True)``."""
        return self.step({"operator": action if value is None else {action: value}}, lasts)

    def world(self, change: str, value: Json, lasts: Optional[Seconds] = None) -> Step:
        """Changes something around it, as ``world("remove", "crate")``."""
        return self.step({"world": {change: value}}, lasts)

    def step(self, step: Mapping[str, Json], lasts: Optional[Seconds] = None) -> Step:
        """Adds a step, in the form of scenario files."""
        whole = {"device": self.name, **step}
        if lasts is not None:
            whole["for"] = span(lasts)
        return Step(self.control, self.control.add_step(whole)["name"])

    @property
    def report(self) -> List[Dict[str, Json]]:
        """What the client did that is forbidden or risky, each with ``code``, ``count``, ``first`` and
        ``first_s``; empty if nothing."""
        devices = self.control.state()["devices"]
        report: List[Dict[str, Json]] = next(one for one in devices if one["name"] == self.name)["report"]
        return report


class Simulator:
    """A running simulator. As a context manager it ends with the block, if it was started here."""

    def __init__(
        self,
        control: Control,
        process: "Optional[subprocess.Popen[bytes]]" = None,
        folder: "Optional[tempfile.TemporaryDirectory[str]]" = None,
        log_path: Optional[Path] = None,
        scenario: bool = False,
    ) -> None:
        self.control = control
        self._scenario = scenario
        self._process = process
        self._folder = folder
        self._log_path = log_path
        # Whether time stands still because of this program.
        self._has_paused = False
        self._is_closed = False
        state = control.state()
        devices = state["devices"]
        #: The kind of time: ``real``, or ``lockstep`` under ``sim run``, where time passes while this program waits.
        self.time: str = state["time"]
        alone = len(devices) == 1
        self.devices = {about["name"]: Device(self, about, alone) for about in devices}
        if process is not None:
            # Without a `with` block it ends with this program.
            atexit.register(self.close)

    @property
    def device(self) -> Device:
        """The first device."""
        return next(iter(self.devices.values()))

    def __getitem__(self, name: str) -> Device:
        return self.devices[name]

    def __getattr__(self, name: str) -> Any:
        # With one device the simulator is as good as the device.
        devices = self.__dict__.get("devices", {})
        if len(devices) == 1 and not name.startswith("_"):
            return getattr(self.device, name)
        if any(hasattr(device, name) for device in devices.values()):
            which = " or ".join(f"simulator[{own!r}].{name}" for own in devices)
            raise AttributeError(f"there are several devices: {which}")
        raise AttributeError(f"a simulator has no {name}")

    @property
    def joined(self) -> bool:
        """Whether it was running already, and keeps running when this program ends."""
        return self._process is None

    @property
    def folder(self) -> Optional[Path]:
        """Where its ports, log and trace are, if it was started here."""
        return self._log_path.parent if self._log_path else None

    @property
    def verdict(self) -> str:
        """The verdict that it printed on the scenario; empty without a scenario, if it passed, or before its end."""
        found = re.search(r"^(FAILED|ERROR|skipped|aborted): .*", self.log, re.MULTILINE | re.DOTALL)
        return found.group() if found else ""

    @property
    def log(self) -> str:
        """What it has printed so far."""
        return self._log_path.read_text(errors="replace") if self._log_path else ""

    def until(self, condition: str, within: Seconds = "5 s", message: Optional[str] = None) -> None:
        """Waits until a condition holds, ``within`` simulated time. Raises :class:`NotReached`."""
        # A test that fails here shows the test, and not this.
        __tracebackhide__ = True
        expect = {"that": condition, "within": span(within)}
        if message is not None:
            expect["message"] = message
        over = self._wait({"expect": expect})
        if over["state"] != "done":
            raise NotReached(over.get("why") or f"`{condition}` did not become true in time")

    def _wait(self, step: Mapping[str, Json]) -> Json:
        """Adds a step and waits until it has ended. Raises if it cannot end, since this program paused time."""
        if not self._has_paused:
            return self.control.add_step(step, wait=True, timeout=3600.0)
        over = self.control.add_step(step)
        if over["state"] not in ("done", "failed"):
            self.control.clear(over["name"])
            raise ControlError("this would never end: time stands still since pause() or advance_by(); call resume()")
        return over

    def get(self, name: str) -> Value:
        """The value of a name now; with several devices it begins with one's, as ``car.truth.x_m``."""
        return self.control.values([name])[name]

    def publish(self, **values: float) -> None:
        """Publishes what the client believes, as ``publish(x=1.2)``: conditions and reports know it as ``client.x``."""
        self.control.publish(values)

    def clear(self) -> None:
        """Cancels all steps added by control, and reverts what they changed."""
        self.control.clear()

    def pause(self) -> None:
        """Pauses simulated time."""
        self.control.time("pause")
        self._has_paused = True

    def resume(self) -> None:
        """Resumes simulated time."""
        self.control.time("resume")
        self._has_paused = False

    def advance_by(self, span_: Seconds) -> None:
        """Advances simulated time by this much, and pauses; returns when it has passed."""
        self.control.time({"step": span(span_)})
        self._has_paused = True

    def advance(self, span_: Seconds) -> None:
        """Waits for this much simulated time, in any kind of time."""
        now = self.now
        step = {"at": span(span_), "expect": {"that": "true"}}
        over = self._wait(step)
        if over["state"] != "done":
            raise ControlError(f"{span_} from {now} s have not passed: {over.get('why')}")

    @property
    def now(self) -> float:
        """Simulated time since the start, s."""
        return float(self.control.state()["t"])

    @property
    def speed(self) -> float:
        """Simulated seconds for each second of real time."""
        speed = self.control.state()["speed"]
        if speed is None:
            raise ControlError("in lockstep time is the client's and has no speed")
        return float(speed)

    @speed.setter
    def speed(self, speed: float) -> None:
        self.control.time({"speed": speed})

    def events(
        self,
        *,
        names: Sequence[str] = (),
        rate: float = 10.0,
        traffic: bool = False,
        timeout: Optional[float] = None,
    ) -> Iterator[Event]:
        """What happens, as it happens; see :meth:`Control.events`."""
        return self.control.events(names=names, rate=rate, traffic=traffic, timeout=timeout)

    def close(self) -> int:
        """Ends a simulator that was started here, and returns its exit code. Further calls only return it."""
        if self._process is None:
            return 0
        if not self._is_closed:
            self._is_closed = True
            atexit.unregister(self.close)
            self._end(self._process)
        return self._process.wait()

    def _end(self, process: "subprocess.Popen[bytes]") -> None:
        try:
            if self._scenario and process.poll() is None:
                self._play_the_rest(process)
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            process.wait(_END_WITHIN)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        finally:
            if self._folder is not None:
                self._folder.cleanup()

    def _play_the_rest(self, process: "subprocess.Popen[bytes]") -> None:
        """The rest of a scenario shows what becomes of the vehicle; if it has begun at all."""
        try:
            self.control.time({"speed": 100})
            self.control.time("resume")
            # A client that has just come is seen with the first question; time passes until the next.
            looks = 0
            while self.now == 0 and looks < _LOOKS:
                time.sleep(0.01)
                looks += 1
            if looks < _LOOKS:
                process.wait(_REST_WITHIN)
        except (ControlError, subprocess.TimeoutExpired):
            # It has ended by now, or is ended.
            pass

    def __enter__(self) -> "Simulator":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def start(
    device: str = "r150",
    *,
    rig: Optional[PathLike] = None,
    scenario: Optional[PathLike] = None,
    world: Optional[PathLike] = None,
    listen: Optional[str] = None,
    settings: Optional[Mapping[str, object]] = None,
    seed: Optional[int] = None,
    speed: float = 1.0,
    folder: Optional[PathLike] = None,
    trace: Optional[PathLike] = None,
    arguments: Sequence[str] = (),
) -> Simulator:
    """Starts a simulator and waits until clients can connect.

    Either one ``device``, or the devices of a ``rig`` file or of a ``scenario``, whose steps happen then.
    One device is served on the network if ``listen`` says where, as ``rfc2217://127.0.0.1:0``.
    ``settings`` are those of ``sim config``, as ``{"r150.heartbeat_timeout": "5s"}``; ``arguments`` go to
    ``sim`` as they are. Pseudo-terminals and log are in ``folder``, or in a new one that goes with the
    simulator, whatever paths a rig file or a scenario has; ``trace`` is written if it is named.
    """
    own = None
    if folder is None:
        own = tempfile.TemporaryDirectory(prefix="rigsim-")
        folder = own.name
    place = Path(folder).absolute()
    ready, log = place / "ready", place / "sim.log"
    ports = place / "ports"
    command = [program(), "--control", "127.0.0.1:0", "--ready-file", str(ready), "--speed", repr(speed), "-v"]
    if rig is not None or scenario is not None:
        ports.mkdir(exist_ok=True)
    if rig is not None:
        command += ["--rig", str(rig), "--pty-folder", str(ports)]
    elif scenario is not None:
        command += ["--scenario", str(scenario), "--pty-folder", str(ports)]
    else:
        command += ["--device", device]
        command += ["--pty", str(place / device)] if listen is None else ["--listen", listen]
    if world is not None:
        command += ["--world", str(world)]
    if seed is not None:
        command += ["--seed", str(seed)]
    for key, value in (settings or {}).items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        command += ["--set", f"{key}={text}"]
    if trace is not None:
        command += ["--trace", str(trace)]
    command += arguments
    with log.open("wb") as out:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT)
    try:
        return Simulator(Control(_wait_for_control(process, ready, log)), process, own, log, scenario is not None)
    except BaseException:
        process.kill()
        process.wait()
        if own is not None:
            own.cleanup()
        raise


def _wait_for_control(process: "subprocess.Popen[bytes]", ready: Path, log: Path) -> str:
    """The URL of a simulator that has just been started."""
    end = time.monotonic() + _READY_WITHIN
    while True:
        text = log.read_text(errors="replace")
        url = re.search(r'http://[^\s"]+#token=\w+', text)
        if url is not None and ready.exists():
            return url.group()
        if process.poll() is not None:
            raise ControlError(f"the simulator ended at once:\n{text}")
        if time.monotonic() > end:
            raise ControlError(f"the simulator is not ready:\n{text}")
        time.sleep(0.01)


def find(port: Optional[PathLike] = None) -> Simulator:
    """A simulator of this user that runs with ``--control``: the one that serves ``port``, or the only
    one."""
    command = [program(), "ctl", *(["--port", str(port)] if port is not None else []), "url"]
    result = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    if result.returncode != 0:
        raise ControlError(result.stderr.strip().removeprefix("error: "))
    return connect(result.stdout.strip())


def connect(url: Optional[str] = None) -> Simulator:
    """The simulator at a URL as it prints it; under ``sim run --control``, that of ``$SIM_CONTROL``."""
    url = url or os.environ.get("SIM_CONTROL")
    if not url:
        raise ControlError("there is no simulator: `sim run` sets SIM_CONTROL when it has --control")
    return Simulator(Control(url))


def joinable() -> bool:
    """Whether this program is the client of a ``sim run`` that can be controlled."""
    if os.environ.get("SIM_CONTROL"):
        return True
    if os.environ.get("SIM_SCENARIO"):
        raise ControlError("`sim run` plays this program, but without `--control 127.0.0.1:0`; add that")
    return False
