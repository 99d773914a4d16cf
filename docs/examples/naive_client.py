#!/usr/bin/env python3
"""The client that is usually written first: it works as long as nothing goes wrong.

    sim run --tag drive scenarios/r150 -- python3 docs/examples/naive_client.py

Needs `pip install pyserial`. It switches 12 V A on for a camera and drives ahead for six seconds.
Compare it with careful_client.py, which does the same.
"""
import os
import struct
import sys
import time

import serial


def crc16(data):  # CRC-16/X-25 over command and parameters
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return struct.pack("<H", crc ^ 0xFFFF)


def ask(port, command, parameters=b""):
    """Sends a request and takes whatever comes next for the answer."""
    body = bytes([command]) + parameters
    port.write(b"\xAA\x55" + bytes([len(parameters)]) + body + crc16(body))
    head = port.read(4)  # waits for ever
    return port.read(head[2] + 2)[:-2]  # neither command nor CRC is looked at


port = serial.Serial(sys.argv[1] if len(sys.argv) > 1 else os.environ["SIM_R150_PORT"], 115200)
print("version", ask(port, 0xF0).hex())
assert ask(port, 0x02, struct.pack("<I", 1)) == b"\x01"
end = time.monotonic() + 6
while time.monotonic() < end:
    right, left, charge = struct.unpack_from("<hhH", ask(port, 0x12, struct.pack("<hh", 357, 357)))
    print(f"right {right} rpm, left {left} rpm, charge {charge / 10} %")
    time.sleep(0.1)
ask(port, 0x12, struct.pack("<hh", 0, 0))
