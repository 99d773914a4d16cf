"""The program under test."""

import sys
import time

import serial

AHEAD = bytes.fromhex("AA 55 04 12 F4 01 F4 01 45 38")

with serial.Serial(sys.argv[1], 115200, timeout=5) as port:
    while True:
        port.write(AHEAD)
        if len(port.read(14)) < 14:
            sys.exit("no answer")
        time.sleep(0.1)
