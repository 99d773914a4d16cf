#!/usr/bin/env python3
"""The client that is usually written first, around a square of 3 m. Compare it with careful_square.py.

    sim run --job docs/examples/square.toml scenarios/r150/faults -- python3 docs/examples/naive_square.py

Needs `pip install pyserial`.
"""
import os
import struct
import time

import serial
from careful_client import crc16
from odometry import Way


def ask(command, parameters=b""):
    """Sends a request and takes whatever comes next for the answer."""
    body = bytes([command]) + parameters
    port.write(b"\xAA\x55" + bytes([len(parameters)]) + body + crc16(body))
    head = port.read(4)  # waits for ever
    return port.read(head[2] + 2)[:-2]  # neither command nor CRC is looked at


port = serial.Serial(os.environ["SIM_R150_PORT"], 115200)
ask(0x02, struct.pack("<I", 1))
way = Way()
while duties := way.duties():
    right, left, charge = struct.unpack_from("<hhH", ask(0x12, struct.pack("<hh", *duties)))
    way.measure(time.monotonic(), right, left)
    time.sleep(0.1)
ask(0x12, struct.pack("<hh", 0, 0))
