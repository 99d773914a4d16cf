#!/usr/bin/env python3
"""Drives a mecanum car around a square, over each of its links in turn, and checks where it ends:
python3 car_square.py /tmp/car /tmp/car-ros (needs `pip install pyserial`).
"""
import struct, sys, time, serial

FORWARD, STRAFE = 0, 2  # moving_idx; a positive strafe goes left

def status(port):
    """The next status packet: x and y in 1/10 revolution, whether a motor runs, magn."""
    packet = port.read(39)
    while packet[:2] != b"\x00\x27":  # it began in the middle of one
        packet = packet[1:] + port.read(1)
        assert len(packet) == 39, "no status packet within a second"
    (x, y), (magn,) = struct.unpack_from("<hh", packet, 7), struct.unpack_from("<H", packet, 17)
    return x, y, packet[36] != 0, magn

def finish(port):
    """Waits until the car has moved and stands; x and y."""
    moved, end = False, time.monotonic() + 60
    while time.monotonic() < end:
        x, y, running, _ = status(port)
        if moved and not running:
            return x, y
        moved = moved or running
    raise AssertionError("still moving after a minute")

def near(place, expected):  # 1/10 revolution each way: a wheel stops a pulse or two late
    assert all(abs(a - b) <= 2 for a, b in zip(place, expected)), f"{place}, not {expected}"

with serial.Serial(sys.argv[1], 115200, timeout=1) as main, \
        serial.Serial(sys.argv[2], 9600, timeout=1) as ros:
    main.write(struct.pack("<BBBhhh", 1, 9, 0, 0, 0, 0))  # here is the origin
    began = time.monotonic()
    for _ in range(10):
        assert status(main)[3] == 0, "the ROS link has the UART of the magnetic sensor"
    print("ten status packets in %.2f s" % (time.monotonic() - began))

    for seq, (moving_idx, v, corner) in enumerate([
            (FORWARD, 300, (20, 0)), (STRAFE, 300, (20, 20)),
            (FORWARD, -300, (0, 20)), (STRAFE, -300, (0, 0))]):
        # 20 tenths of a revolution of each wheel at v tenths of a revolution a minute.
        main.write(struct.pack("<BBBBBHh", 0, 9, seq, 1, moving_idx, 20, v))
        place = finish(main)
        print("packet %d: at %.1f %.1f revolutions" % (seq, place[0] / 10, place[1] / 10))
        near(place, corner)

    ros.reset_input_buffer()
    ros.readline()  # perhaps the end of a line
    speed, mileage = (int(word[1:]) for word in ros.readline().split())  # V0 S803
    assert speed == 0, "it stands"
    for line, corner in [(b"X20 \n", (20, 0)), (b"Y20 \n", (20, 20)),
                         (b"X-20 \n", (0, 20)), (b"Y-20 \n", (0, 0))]:
        ros.write(line)
        place = finish(main)
        print("line %s: at %.1f %.1f revolutions" % (line, place[0] / 10, place[1] / 10))
        near(place, corner)
    ros.reset_input_buffer()
    ros.readline()
    driven = int(ros.readline().split()[1][1:]) - mileage
    print("the report lines say %.2f revolutions for 4 times 2" % (driven / 100))
    assert 790 <= driven <= 830
