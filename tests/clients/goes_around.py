"""A car that stops at 0.2 m, drives around what it sees, and starts again whenever its board has stopped."""

import os
import struct
import time
import tty

CLOSE_MM = 200
port = os.open(os.environ["SIM_MECANUM_PORT"], os.O_RDWR | os.O_NOCTTY)
tty.setraw(port)


def drive(course, tenths):
    os.write(port, struct.pack("<5BHh", 0, 9, 0, 1, course, tenths, 300 if tenths else 0))


heard, sent, strafed, end = b"", 0.0, False, time.monotonic() + 11
while time.monotonic() < end:
    heard += os.read(port, 512)
    start = heard.find(b"\0\x27")
    if start < 0 or len(heard) < start + 39:
        continue
    status, heard = heard[start : start + 39], heard[start + 39 :]
    is_close = status[19] or any(20 < distance < CLOSE_MM for distance in struct.unpack_from("<4H", status, 20))
    stands, now = status[36] == 0, time.monotonic()
    seen = status[19]
    if is_close and not stands and not strafed:
        drive(0, 0)
    elif stands and now - sent > 0.2 and not strafed and (seen or not is_close):
        strafed = bool(seen)
        drive(2 if strafed else 0, 15 if strafed else 30)
        sent = now
drive(0, 0)
