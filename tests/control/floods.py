"""Floods of connections and requests, and readers that do not read: no other client is kept waiting for long."""

import socket
import time

from simulator import ADDRESS, HEARTBEAT, PATIENCE, Events, ask, call, raw, request, status


def patiently(make):
    """What it makes, tried until there is room for the connection."""
    end = time.monotonic() + PATIENCE
    while True:
        try:
            return make()
        except (AssertionError, ConnectionError):
            assert time.monotonic() < end
            time.sleep(0.05)


def state():
    return patiently(lambda: call("GET", "/v1/state"))


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
state()

# Requests by the hundred on one connection, whose answers fit into what waits between the two, and wrong ones.
good = request("GET /v1/names?names=t HTTP/1.1").replace(b"Connection: close\r\n", b"")
for _ in range(5):
    many = patiently(lambda: raw(good * 200 + request("GET /v1/names?names=t HTTP/1.1")))
    assert many.count("HTTP/1.1 200 ") == 201, many[:500]
for _ in range(50):
    assert patiently(lambda: status(request(token="wrong"))) == 401

# Connections that are aborted at any point.
for length in range(0, len(good), 7):
    with socket.create_connection(ADDRESS, timeout=PATIENCE) as one:
        one.sendall(good[:length])
state()

# A reader that does not read costs the others nothing, and one that reads slowly learns what it lost.
names = ",".join(one["name"] for one in patiently(lambda: call("GET", "/v1/names"))["names"][:64])
wanted = f"?names={names}&rate=60&picture=60"
deaf = [patiently(lambda: Events(f"{wanted}&traffic=true", buffer=4096)) for _ in range(3)]
lost = False
for pause in [0.05, 0.1, 0.2, 0.4, 0.1, 0.2]:
    # How slow is slow, and not too slow altogether, depends on what else the machine does.
    slow = patiently(lambda: Events(wanted, buffer=4096))
    end = time.monotonic() + PATIENCE
    tail = b""
    while not lost and time.monotonic() < end:
        try:
            chunk = slow.socket.recv(2000)
        except ConnectionError:
            chunk = b""
        if not chunk:
            # It was too slow.
            break
        tail = tail[-200:] + chunk
        lost = b"event: lost\n" in tail
        time.sleep(pause)
    if lost:
        break
assert lost
assert ask(HEARTBEAT, 7)
assert state()["devices"]
