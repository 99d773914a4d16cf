#!/usr/bin/env python3
"""A client of the mecanum car that expects trouble.

    sim run --tag drive scenarios/mecanum -- python3 docs/examples/careful_car_client.py

Needs `pip install pyserial`. It drives around a rectangle and comes back: three revolutions of the
wheels ahead and one to the left by packets on the main link, then three back and one to the right
by lines on the ROS link. It orders a way, watches in the status packets what comes of it, and
orders what is left of it. When something is wrong with the car it stops for good; when it only hears
nothing, or a person is in the way, it stops, waits, and goes on.
"""
import os
import struct
import sys
import termios
import time

import serial

# Sides by axis, corner to drive to in 1/10 revolution, and whether by lines on the ROS link.
SIDES = [("x", 30, False), ("y", 10, False), ("x", 0, True), ("y", 0, True)]
MOVING_IDX = {"x": 0, "y": 2}
LETTER = {"x": "X", "y": "Y"}
SPEED = 300  # 1/10 r/min, 0.16 m/s
NEAR_MM = 350  # to stop for; the car needs 10 mm, and its client a packet or two
DEAF_S = 0.5  # five status packets
STOP = struct.pack("<BBBBBHh", 0, 9, 0, 1, 0, 0, 0)  # no distance, discarding what runs and waits
BOARD_DRIVES = bytes([2, 4, 0, 0])


class Trouble(Exception):
    """Something is wrong with the car, and a person has to look at it."""


class Link:
    """A port that may hang up, and come back."""

    def __init__(self, path, baud):
        self.path, self.baud = path, baud
        self.port = None
        self.tried = 0.0

    def use(self, action):
        """Does something with the port if there is one; nothing comes of it otherwise."""
        try:
            if self.port is None:
                if time.monotonic() - self.tried < 0.05:
                    return b""
                self.tried = time.monotonic()
                self.port = serial.Serial(self.path, self.baud, timeout=0, write_timeout=1)
            return action(self.port)
        except (OSError, termios.error):  # a SerialException is an OSError
            port, self.port = self.port, None
            if port is not None:
                print(f"{self.path} has hung up")
                try:
                    port.close()
                except (OSError, termios.error):
                    pass
            return b""

    def read(self):
        return self.use(lambda port: port.read(4096))

    def write(self, data):
        self.use(lambda port: port.write(data))


class Status:
    """A status packet. There is no checksum, so what it says has to be likely."""

    FORM = struct.Struct("<BBBhhhhhIHB4H4HBH")
    HEAD = bytes([0, FORM.size])

    def __init__(self, packet):
        values = self.FORM.unpack(packet)
        self.at = time.monotonic()
        self.x, self.y, self.ori = values[5:8]  # 1/10 revolution, 1/10 degree
        self.infra = values[10]
        self.distances = values[11:19]  # mm, four in front and four in the rear
        self.motors, self.mile = values[19:]

    def is_possible(self):
        distances = all(20 <= distance <= 4500 for distance in self.distances)
        return distances and self.infra <= 1 and self.motors <= 3

    def can_follow(self, other):
        """Whether the car can have come from there to here: 8.3 tenths of a revolution a second,
        70 degrees, 262 mm, and a little more."""
        time_s = self.at - other.at
        way = max(abs(self.x - other.x), abs(self.y - other.y))
        mile = (self.mile - other.mile) % 65536
        return (
            way <= 3 + 10 * time_s
            and abs(self.ori - other.ori) <= 150 + 800 * time_s
            and mile <= 80 + 300 * time_s
        )

    def is_clear(self, axis, sign):
        """Whether nothing is near on that side; no sensor looks to the left and right."""
        if axis == "y":
            return True
        ahead = self.distances[:4] if sign > 0 else self.distances[4:]
        return min(ahead) >= NEAR_MM and not (sign > 0 and self.infra)


class Car:
    """The state of the car as far as it is known, and the orders to it."""

    def __init__(self, main, ros):
        self.main, self.ros = main, ros
        self.buffer = bytearray()
        self.status = None  # the last that was believed
        self.doubtful = None  # one that does not fit it
        self.forgotten = None  # where the car was when its board forgot it
        self.greeted = 0.0

    def pass_time(self):
        """For a hundredth of a second takes in whatever comes, and sends a sign of life."""
        self.buffer += self.main.read()
        while len(self.buffer) >= Status.FORM.size:
            status = None
            if self.buffer.startswith(Status.HEAD):
                status = Status(self.buffer[: Status.FORM.size])
            if status and status.is_possible():
                del self.buffer[: Status.FORM.size]
                self.take(status)
            else:  # not a packet; one may begin at the next byte
                del self.buffer[0]
        if self.ros:
            self.ros.read()  # says nothing that the packets do not say
        if time.monotonic() - self.greeted > 0.25:
            self.greeted = time.monotonic()
            self.main.write(BOARD_DRIVES)
        time.sleep(0.01)

    def take(self, new):
        """Believes a packet that fits the one before; another one only if the next one fits it."""
        old = self.status
        if old and not new.can_follow(old):
            if not (self.doubtful and new.can_follow(self.doubtful)):
                self.doubtful = new
                return
            # The board has begun again, or a spoilt packet has set its pose; the car is where it last was.
            self.forgotten = old
        self.status, self.doubtful = new, None

    def statuses(self, patience_s):
        """Status packets, until none has come for so long."""
        seen, since = self.status, time.monotonic()
        while True:
            # What has come while a busy machine had no time for this program counts as well.
            late = time.monotonic() - since > patience_s
            self.pass_time()
            if self.status is not seen:
                seen, since = self.status, time.monotonic()
                yield seen
            elif late:
                return

    def look(self):
        """Waits for a status, and tells the board where it is if it does not know."""
        if next(self.statuses(10.0), None) is None:
            raise Trouble("no status packets")
        if self.forgotten:
            print("the board has lost its place")
            self.set_pose(self.forgotten.x, self.forgotten.y, self.forgotten.ori)

    def set_pose(self, x, y, ori):
        for _ in range(20):
            self.main.write(struct.pack("<BBBhhh", 1, 9, 0, x, y, ori))
            end = time.monotonic() + 0.4
            for status in self.statuses(0.4):
                if abs(status.x - x) + abs(status.y - y) <= 1 and abs(status.ori - ori) < 5:
                    self.forgotten = None
                    return
                if time.monotonic() > end:
                    break
        raise Trouble("the board does not take its position")

    def stop(self):
        """Asks for standstill on both links until two packets in a row say so, which may not come."""
        standing = 0
        for _ in range(100):
            self.main.write(STOP)
            if self.ros:
                self.ros.write(b"\nX0 \n")
            status = next(self.statuses(0.15), None)
            standing = standing + 1 if status and not status.motors else 0
            if standing == 2:
                return True
        print("the car does not say that it stands")
        return False

    def order(self, axis, way, by_line):
        if by_line:
            # The first line end cuts off whatever noise may have left on the line.
            self.ros.write(f"\n{LETTER[axis]}{way} \n".encode())
        else:
            speed = SPEED if way > 0 else -SPEED
            packet = struct.pack("<BBBBBHh", 0, 9, 0, 1, MOVING_IDX[axis], abs(way), speed)
            self.main.write(packet)

    def wait_until_clear(self, axis, sign):
        clear, end = 0, time.monotonic() + 15
        for status in self.statuses(DEAF_S):
            clear = clear + 1 if status.is_clear(axis, sign) else 0
            if clear == 3:
                return
            if time.monotonic() > end:
                raise Trouble("the way does not become clear")

    def watch(self, axis, corner, by_line):
        """Watches the car on its way. Says why it has to be stopped; None if it has stopped."""
        begin, begun = self.status, time.monotonic()
        sign = 1 if corner > getattr(begin, axis) else -1
        nearest = begin_left = (corner - getattr(begin, axis)) * sign
        # Packets in a row that say so; counted, since a busy machine may bring many at once.
        stuck = standing = strayed = 0
        ran = False
        for status in self.statuses(DEAF_S):
            left = (corner - getattr(status, axis)) * sign
            aside = status.y - begin.y if axis == "x" else status.x - begin.x
            if self.forgotten:
                return "the board has lost its place"
            if not status.is_clear(axis, sign):
                return "a person is in the way"
            # Two packets in a row may be wrong: too little to give up.
            strayed = strayed + 1 if abs(aside) > 3 or abs(status.ori) > 80 else 0
            if strayed >= 2 and by_line and left >= begin_left and abs(status.ori) <= 80:
                return "a line was misheard"  # it goes aside alone
            if strayed == 3:
                raise Trouble(f"off course: {aside / 10} revolutions, {status.ori / 10} degrees")
            if left < -2 or left > begin_left + 2:
                return "that was another order than it should have been"
            stuck = stuck + 1 if status.motors and left >= nearest else 0
            if stuck == 15:
                raise Trouble("the motors run, and the car does not move")
            nearest = min(left, nearest)
            if status.motors:
                ran, standing = True, 0
            else:
                standing += 1
                if standing >= 2 and not strayed and (ran or time.monotonic() - begun > 0.6):
                    return None
        return "nothing to be heard"

    def drive(self, axis, corner, by_line):
        """Drives to the corner, in as many orders as it takes."""
        orders = 0
        while True:
            self.look()
            way = corner - getattr(self.status, axis)
            if abs(way) <= 1:
                return
            if orders == 12:
                raise Trouble("the car does not follow its orders")
            self.wait_until_clear(axis, way)
            # Lines that come to nothing are given up; the main link can do the same.
            line = by_line and self.ros and orders < 3
            self.order(axis, way, line)
            orders += 1
            why = self.watch(axis, corner, line)
            if why:
                print(f"stop: {why}")
                if not self.stop():
                    raise Trouble("it cannot be seen whether the car stands")


def main(sides=SIDES):
    paths = sys.argv[1:] or [os.environ["SIM_MECANUM_PORT"], os.environ.get("SIM_MECANUM_ROS_PORT")]
    # Where the car has no second link, all goes by packets.
    car = Car(Link(paths[0], 115200), Link(paths[1], 9600) if paths[1] else None)
    try:
        car.look()
        car.set_pose(0, 0, 0)
        for axis, corner, by_line in sides:
            car.drive(axis, corner, by_line)
        for axis in "xy":
            car.drive(axis, 0, False)  # no way at all, unless a line that was misheard led aside
        print("back where it began")
    except Trouble as trouble:
        print(f"stopped for good: {trouble}")
    car.stop()


if __name__ == "__main__":
    main()
