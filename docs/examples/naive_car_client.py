#!/usr/bin/env python3
"""The client of the mecanum car that is usually written first: it works as long as nothing goes wrong.

    sim run --tag drive scenarios/mecanum -- python3 docs/examples/naive_car_client.py

Needs `pip install pyserial`. It drives around a rectangle and comes back: three revolutions of the
wheels ahead and one to the left by packets on the main link, then three back and one to the right by
lines on the ROS link. Compare it with careful_car_client.py, which does the same.
"""
import os
import struct
import sys

import serial

AHEAD, STRAFE = 0, 2  # moving_idx


def finish():
    """Waits until the car has moved and stands again."""
    moved = False
    while True:
        packet = main.read(39)  # waits for ever, and never asks where a packet begins
        x, y = struct.unpack_from("<hh", packet, 7)
        running = packet[36] != 0
        if moved and not running:
            print(f"at {x / 10} {y / 10} revolutions")
            return
        moved = moved or running


def move(moving_idx, distance, speed):  # 1/10 revolution, 1/10 r/min
    main.write(struct.pack("<BBBBBHh", 0, 9, 0, 1, moving_idx, distance, speed))
    finish()


def line(text):
    ros.write(text)
    finish()


paths = sys.argv[1:] or [os.environ["SIM_MECANUM_PORT"], os.environ["SIM_MECANUM_ROS_PORT"]]
main, ros = serial.Serial(paths[0], 115200), serial.Serial(paths[1], 9600)
main.read_until(b"\x00\x27")  # the first packet may have begun before
main.read(37)
main.write(struct.pack("<BBBhhh", 1, 9, 0, 0, 0, 0))  # here is the origin
move(AHEAD, 30, 300)
move(STRAFE, 10, 300)
line(b"X-30 \n")
line(b"Y-10 \n")
