"""Speaks with a simulator over http.client, as the tests in this folder need it."""

import http.client
import json
import os
import socket
import time

HOST, TOKEN = os.environ["SIM_CONTROL"].removeprefix("http://").split("/#token=")
ADDRESS = (HOST.rsplit(":", 1)[0], int(HOST.rsplit(":", 1)[1]))
# Spent only on failure, since the machine may be busy.
PATIENCE = 60


def call(method, path, body=None, status=None, headers=None):
    """A call on its own connection; the status must be this, or 200 or 201."""
    connection = http.client.HTTPConnection(HOST, timeout=PATIENCE)
    headers = {"Authorization": f"Bearer {TOKEN}"} if headers is None else headers
    if body is not None and not isinstance(body, (str, bytes)):
        body = json.dumps(body)
    connection.request(method, path, body, headers)
    answer = connection.getresponse()
    text = answer.read().decode()
    connection.close()
    wanted = (200, 201) if status is None else (status,)
    assert answer.status in wanted, (method, path, str(body)[:200], answer.status, text[:500])
    if answer.getheader("Content-Type") == "application/json":
        return json.loads(text)
    return text


def step(body, status=None, wait=False):
    return call("POST", "/v1/steps" + ("?wait=true" if wait else ""), body, status)


def until(condition, within="60 s"):
    done = step({"expect": {"that": condition, "within": within}}, wait=True)
    assert done["state"] == "done", done


def raw(data, patience=PATIENCE):
    """What comes back for these bytes, until the other side closes."""
    with socket.create_connection(ADDRESS, timeout=patience) as connection:
        connection.sendall(data)
        answer = b""
        while chunk := connection.recv(65536):
            answer += chunk
    return answer.decode()


def request(line="GET /v1/state HTTP/1.1", host=HOST, token=TOKEN, more="", body=""):
    """A request as text, which closes its connection."""
    fields = "".join(
        f"{name}: {value}\r\n"
        for name, value in [("Host", host), ("Authorization", token and f"Bearer {token}")]
        if value is not None
    )
    return f"{line}\r\n{fields}Connection: close\r\n{more}\r\n{body}".encode()


def status(data):
    return int(raw(data).split(" ", 2)[1])


class Events:
    """The events of a stream."""

    def __init__(self, query="", buffer=None):
        self.socket = socket.socket()
        if buffer is not None:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        self.socket.settimeout(PATIENCE)
        self.socket.connect(ADDRESS)
        self.socket.sendall(request(f"GET /v1/events{query} HTTP/1.1"))
        self.file = self.socket.makefile("rb", buffering=0 if buffer else -1)
        line = self.file.readline()
        assert b" 200 " in line, line
        while self.file.readline().strip():
            pass

    def lines(self):
        """What comes for each line, also for those that only keep the stream alive."""
        kind = None
        while line := self.file.readline():
            line = line.decode().rstrip("\n")
            if line.startswith("event: "):
                kind = line[7:]
            yield (kind, json.loads(line[6:])) if line.startswith("data: ") else None

    def __iter__(self):
        return (event for event in self.lines() if event is not None)

    def wait(self, kind, fits=lambda data: True):
        end = time.monotonic() + PATIENCE
        for event in self.lines():
            if event is not None and event[0] == kind and fits(event[1]):
                return event[1]
            assert time.monotonic() < end, f"no {kind} in {PATIENCE} s"
        raise AssertionError(f"the stream has ended without {kind}")


def port():
    return call("GET", "/v1/state")["devices"][0]["ports"][0]["path"]


def ask(data, length):
    """Asks the device at its port, which must answer with so many bytes."""
    file = os.open(port(), os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        os.write(file, data)
        answer, end = b"", time.monotonic() + PATIENCE
        while len(answer) < length:
            assert time.monotonic() < end, answer
            try:
                answer += os.read(file, 100)
            except BlockingIOError:
                time.sleep(0.002)
        return answer
    finally:
        os.close(file)


HEARTBEAT = bytes.fromhex("AA 55 00 07 C7 84")

