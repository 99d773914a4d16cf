#!/usr/bin/env python3
"""Follows a magnetic strip: python3 line_following.py /tmp/car (needs `pip install pyserial`).

For a mecanum car in worlds/line-loop.toml. Steers by `magn` alone, and lists the RFID tags that it
passes until it meets the first one again.
"""
import struct, sys, time, serial

FORWARD, ROTATE = 0, 1  # moving_idx
RIGHT, LEFT = 1, -1  # signs of a rotation

def status(port):
    """The next status packet: rfid and magn."""
    packet = port.read(39)
    while packet[:2] != b"\x00\x27":  # it began in the middle of one
        packet = packet[1:] + port.read(1)
        assert len(packet) == 39, "no status packet within a second"
    return struct.unpack_from("<IH", packet, 13)

def move(port, moving_idx, s, v):
    """Replaces the running motion: s in 1/10 revolution of a wheel, v in 1/10 r/min."""
    port.write(struct.pack("<BBBBBHh", 0, 9, 0, 1, moving_idx, s, v))

def steer(magn, turning):
    """What to do: 0 to go ahead, RIGHT or LEFT to turn on the spot."""
    hits = [channel for channel in range(16) if magn >> channel & 1]
    if not hits:
        return turning or LEFT  # lost: turn on, as before
    off = sum(hits) / len(hits) - 7.5  # in channels of 10 mm; bit 0 is the leftmost
    if turning and off * turning > 0.5:
        return turning  # turn until the strip is in the middle
    if abs(off) > 2:
        return RIGHT if off > 0 else LEFT
    return 0

with serial.Serial(sys.argv[1], 115200, timeout=1) as port:
    tags, turning, end = [], 0, time.monotonic() + 180
    while len(tags) < 2 or tags[-1] != tags[0]:
        assert time.monotonic() < end, "not around in three minutes"
        rfid, magn = status(port)
        if rfid and rfid not in tags[-1:]:
            tags.append(rfid)
            print("passed tag", rfid, flush=True)
        turning = steer(magn, turning)
        # Short motions, renewed before they end: a client that is late stops the car.
        if turning:
            move(port, ROTATE, 1, 150 * turning)
        else:
            move(port, FORWARD, 3, 400)
    move(port, FORWARD, 0, 0)  # no distance: stop
    assert tags == [101, 102, 103, 104, 101], f"not the tags of worlds/line-loop.toml: {tags}"
