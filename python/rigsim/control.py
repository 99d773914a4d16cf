"""The control of a simulator: HTTP and JSON over a local socket."""

from __future__ import annotations

import http.client
import json
import socket
import threading
from dataclasses import dataclass
from typing import Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple, Union
from urllib.parse import quote, urlencode, urlsplit

Value = Union[float, bool, None]
Json = Any


class ControlError(Exception):
    """The simulator does not answer, or refuses."""


class Refused(ControlError):
    """The simulator refuses; the text says why."""

    def __init__(self, status: int, why: str) -> None:
        super().__init__(why)
        self.status = status


class NotReached(AssertionError):
    """A condition did not become true in time."""

    # Where users know it from, which is what a failing test shows.
    __module__ = "rigsim"


@dataclass(frozen=True)
class Event:
    """An event of a simulator: ``log``, ``values``, ``picture``, ``past``, ``step``, ``failure``, ``time``,
    ``lost`` or ``end``."""

    kind: str
    data: Dict[str, Json]


class Control:
    """The calls of control as methods. :class:`rigsim.Device` is more convenient."""

    def __init__(self, url: str) -> None:
        """``url`` is what the simulator prints, with the token in it."""
        parts = urlsplit(url)
        token = dict(item.partition("=")[::2] for item in parts.fragment.split("&")).get("token")
        if parts.scheme != "http" or not parts.hostname or not parts.port or not token:
            raise ValueError(f"{url!r} is not the URL of a simulator, as http://127.0.0.1:4000/#token=...")
        self.url = url
        self._host, self._port = parts.hostname, parts.port
        self._headers = {"Authorization": f"Bearer {token}"}
        self._local = threading.local()

    def call(self, method: str, path: str, body: Json = None, timeout: float = 30.0) -> Json:
        """Sends a request and returns the answer; ``timeout`` is real time in seconds.

        Raises :class:`Refused`, or :class:`ControlError` when there is no answer.
        """
        payload = None if body is None else json.dumps(body)
        status, text = self._exchange(method, path, payload, timeout)
        answer = json.loads(text)
        if status >= 300:
            raise Refused(status, answer.get("error", f"refused with {status}"))
        return answer

    def _exchange(
        self, method: str, path: str, payload: Optional[str], timeout: float
    ) -> Tuple[int, bytes]:
        # A connection that was idle for long is closed by the simulator, which shows only when it is
        # used again. Nothing has been done then, so that asking once more is safe.
        kept: Optional[http.client.HTTPConnection] = getattr(self._local, "connection", None)
        for connection in [kept, None] if kept else [None]:
            fresh = connection is None
            if connection is None:
                connection = http.client.HTTPConnection(self._host, self._port)
            connection.timeout = timeout
            try:
                if connection.sock is not None:
                    connection.sock.settimeout(timeout)
                connection.request(method, path, payload, self._headers)
                response = connection.getresponse()
                text = response.read()
            except (ConnectionError, http.client.RemoteDisconnected) as error:
                connection.close()
                self._local.connection = None
                if fresh:
                    raise ControlError(f"the simulator at {self._host}:{self._port}: {error}") from error
                continue
            except (OSError, http.client.HTTPException) as error:
                connection.close()
                self._local.connection = None
                raise ControlError(f"the simulator at {self._host}:{self._port}: {error}") from error
            self._local.connection = None if response.will_close else connection
            return response.status, text
        raise AssertionError("the last try either answers or raises")

    def add_step(self, step: Mapping[str, Json], wait: bool = False, timeout: float = 60.0) -> Json:
        """Adds a step; with ``wait``, returns when it has ended."""
        return self.call("POST", f"/v1/steps{'?wait=true' if wait else ''}", step, timeout)

    def steps(self) -> List[Json]:
        """All steps with their states."""
        steps: List[Json] = self.call("GET", "/v1/steps")["steps"]
        return steps

    def step(self, name: str) -> Json:
        """The state of the step of this name."""
        return self.call("GET", f"/v1/steps/{quote(name, safe='')}")

    def clear(self, name: Optional[str] = None) -> Json:
        """Cancels a step, or all steps added by control, and reverts what they changed."""
        path = "/v1/steps" if name is None else f"/v1/steps/{quote(name, safe='')}"
        return self.call("DELETE", path)

    def values(self, names: Sequence[str]) -> Dict[str, Value]:
        """The values of names of ``sim names`` now."""
        values: Dict[str, Value] = self.call("GET", f"/v1/names?names={quote(','.join(names), safe=',')}")["values"]
        return values

    def names(self) -> List[Dict[str, str]]:
        """All names, with unit and meaning."""
        names: List[Dict[str, str]] = self.call("GET", "/v1/names")["names"]
        return names

    def state(self) -> Json:
        """Devices, world, steps, reports and time."""
        return self.call("GET", "/v1/state")

    def schema(self) -> Json:
        """The JSON Schemas of steps and of changes of time."""
        return self.call("GET", "/v1/schema")

    def publish(self, values: Mapping[str, float]) -> Json:
        """Publishes numbers, which conditions and reports know as ``client.NAME``."""
        return self.call("POST", "/v1/published", dict(values))

    def time(self, change: Json) -> Json:
        """Changes simulated time: ``"pause"``, ``"resume"``, ``{"step": "5 ms"}``, ``{"speed": 2}``."""
        return self.call("POST", "/v1/time", change)

    def events(
        self,
        *,
        names: Sequence[str] = (),
        rate: float = 10.0,
        picture: Optional[float] = None,
        traffic: bool = False,
        timeout: Optional[float] = None,
    ) -> Iterator[Event]:
        """Events as they happen, until the simulation ends. ``rate`` and ``picture`` are messages a second
        of values and of poses. Raises :class:`ControlError` if nothing comes for ``timeout`` seconds."""
        query: Dict[str, Json] = {"traffic": str(traffic).lower()}
        if names:
            query.update(names=",".join(names), rate=rate)
        if picture is not None:
            query["picture"] = picture
        connection = http.client.HTTPConnection(self._host, self._port, timeout=timeout)
        try:
            connection.request("GET", f"/v1/events?{urlencode(query)}", headers=self._headers)
            response = connection.getresponse()
            if response.status != 200:
                raise Refused(response.status, json.loads(response.read()).get("error", ""))
            kind = ""
            while True:
                line = response.readline().decode().rstrip("\n")
                if line.startswith("event: "):
                    kind = line[7:]
                elif line.startswith("data: "):
                    yield Event(kind, json.loads(line[6:]))
                    if kind == "end":
                        return
                elif not line and response.isclosed():
                    return
        except (OSError, http.client.HTTPException, socket.timeout) as error:
            raise ControlError(f"the simulator's events: {error}") from error
        finally:
            connection.close()
