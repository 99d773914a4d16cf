"""Floods of connections and requests, and readers that do not read: nobody else is kept waiting for long."""

import socket
import time

from simulator import ADDRESS, HEARTBEAT, PATIENCE, Events, ask, call, raw, request, status


def patient():
    """An answer, tried until there is room for the connection."""
    end = time.monotonic() + PATIENCE
    while True:
        try:
            return call("GET", "/v1/state")
        except (AssertionError, ConnectionError):
            assert time.monotonic() < end
            time.sleep(0.05)


# More connections than are taken: the others are turned away, and clients of the port see nothing of it.
idle = [socket.create_connection(ADDRESS, timeout=PATIENCE) for _ in range(200)]
refused = 0
for one in idle:
    one.setblocking(False)
end = time.monotonic() + PATIENCE
while refused < 200 - 32:
    assert time.monotonic() < end, refused
    refused = 0
    for one in idle:
        try:
            refused += one.recv(1000, socket.MSG_PEEK).startswith(b"HTTP/1.1 503")
        except BlockingIOError:
            pass
        except ConnectionError:
            refused += 1
for one in idle:
    one.close()
patient()

# Requests by the thousand on one connection, good ones and wrong ones.
good = request().replace(b"Connection: close\r\n", b"")
assert raw(good * 1500 + request()).count("HTTP/1.1 200 ") == 1501
for _ in range(50):
    assert status(request(token="wrong")) == 401

# Connections that are broken off at any point.
for length in range(0, len(good), 7):
    with socket.create_connection(ADDRESS, timeout=PATIENCE) as one:
        one.sendall(good[:length])
patient()

# A reader that does not read costs nobody anything, and one that reads slowly is told what it lost.
names = ",".join(one["name"] for one in call("GET", "/v1/names")["names"][:64])
deaf = [Events(f"?names={names}&rate=60&picture=60&traffic=true", buffer=4096) for _ in range(3)]
lost = 0
for attempt in range(5):
    slow = Events(f"?names={names}&rate=60&picture=60", buffer=4096)
    end = time.monotonic() + PATIENCE
    tail = b""
    while not lost and time.monotonic() < end:
        chunk = slow.socket.recv(2000)
        if not chunk:
            # It was too slow altogether, as on a busy machine.
            break
        tail = tail[-200:] + chunk
        lost = b"event: lost\n" in tail
        time.sleep(0.05)
    if lost:
        break
assert lost
assert ask(HEARTBEAT, 7)
assert patient()["devices"]
