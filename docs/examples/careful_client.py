#!/usr/bin/env python3
"""A client that expects trouble.

    sim run --tag drive scenarios/r150 -- python3 docs/examples/careful_client.py

Needs `pip install pyserial`. It switches 12 V A on for a camera and drives ahead for six seconds.
When something is wrong with the vehicle it stops for good; when it only hears nothing, it stops,
waits, sets the outputs again and goes on.
"""
import os
import struct
import sys
import time

import serial

VERSION, POWER, SYSTEM_INFO, SET_MOTORS = 0xF0, 0x02, 0x06, 0x12
CAMERA = 1 << 0  # 12 V A
DUTY = 357  # 0.1 %, about 0.5 m/s
RPM_PER_DUTY = 1513 / 1000
TICK_S = 0.1  # between motor commands; the module answers no more than 20 a second
DRIVE_S = 6.0


def crc16(data):  # CRC-16/X-25 over command and parameters
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return struct.pack("<H", crc ^ 0xFFFF)


class Trouble(Exception):
    """Something is wrong with the vehicle, and a person has to look at it."""


class Link:
    """The line to the module. It finds valid frames in whatever comes, and the port again."""

    # Parameters of replies; a frame of another length is not one.
    LENGTHS = {VERSION: 8, POWER: 1, SYSTEM_INFO: 76, SET_MOTORS: 8}

    def __init__(self, path):
        self.path = path
        self.port = None
        self.buffer = bytearray()
        self.touched = 0.0
        self.open()

    def open(self, patience_s=10.0):
        """Opens the port, which may not be there for a while."""
        end = time.monotonic() + patience_s
        while True:
            try:
                self.port = serial.Serial(self.path, 115200, timeout=0, write_timeout=1)
                self.buffer.clear()
                return
            except (OSError, serial.SerialException):
                if time.monotonic() > end:
                    raise Trouble(f"{self.path} does not come back") from None
                time.sleep(0.05)

    def send(self, command, parameters=b""):
        body = bytes([command]) + parameters
        self.port.write(b"\xAA\x55" + bytes([len(parameters)]) + body + crc16(body))

    def frames(self, until):
        """Yields every valid reply that comes until then."""
        while True:
            frame = self.next_frame()
            if frame:
                yield frame
                continue
            # What has come while a busy machine had no time for this program counts as well.
            late = time.monotonic() >= until
            new = self.port.read(4096)
            if new:
                self.buffer += new
                self.touched = time.monotonic()
            elif late:
                return
            else:
                time.sleep(0.002)

    def next_frame(self):
        buffer = self.buffer
        while True:
            start = buffer.find(b"\xAA\x55")
            # What cannot be the beginning of a header is of no use.
            keep = start if start >= 0 else len(buffer) - buffer.endswith(b"\xAA")
            del buffer[:keep]
            if len(buffer) < 4:
                return None
            length, command = buffer[2], buffer[3]
            if self.LENGTHS.get(command) == length:
                if len(buffer) < length + 6:
                    if time.monotonic() - self.touched < 0.05:
                        return None
                    # The rest of it was lost, and is not what comes next.
                elif crc16(buffer[3 : length + 4]) == buffer[length + 4 : length + 6]:
                    frame = command, bytes(buffer[4 : length + 4])
                    del buffer[: length + 6]
                    return frame
            # Not a frame; one may begin at the next byte.
            del buffer[0]

    def ask(self, command, parameters=b"", patience_s=10.0):
        """Asks until there is an answer to this very command."""
        end = time.monotonic() + patience_s
        while time.monotonic() < end:
            self.send(command, parameters)
            for answered, reply in self.frames(time.monotonic() + 0.2):
                if answered == command:
                    return reply
        raise Trouble(f"no answer to command {command:#04x}")


def check(info):
    """Whether the camera has its supply; anything else that is wrong is trouble."""
    (system,) = struct.unpack_from("<I", info, 48)
    app_has_power, rails_on = info[52], info[54]
    if system:
        raise Trouble(f"sysStatus is {system:#x}")
    if app_has_power:
        raise Trouble("the app has taken control of the outputs")
    return bool(rails_on & CAMERA)


def prepare(link):
    """Makes sure that the module answers and that the camera has its supply."""
    link.ask(VERSION)
    for _ in range(5):
        if link.ask(POWER, struct.pack("<I", CAMERA)) == b"\x01" and check(link.ask(SYSTEM_INFO)):
            return
    raise Trouble("12 V A does not come on")


class Drive:
    """What is known while driving."""

    right = left = DUTY

    def __init__(self, link):
        self.link = link
        self.resume()
        self.driven = 0.0

    def resume(self):
        now = time.monotonic()
        self.heard = self.informed = now
        # From when on the speeds have been as they should be; it takes a while to get there.
        self.speeds_right = now + 0.5

    def tick(self):
        """Drives for a tenth of a second, by the clock and not by the replies."""
        begun = time.monotonic()
        self.link.send(SET_MOTORS, struct.pack("<hh", self.right, self.left))
        if begun - self.informed > 0.3:
            self.link.send(SYSTEM_INFO)
        for command, reply in self.link.frames(begun + TICK_S):
            self.heard = time.monotonic()
            if command == SET_MOTORS:
                self.look_at_motors(*struct.unpack_from("<hhH", reply))
            elif command == SYSTEM_INFO:
                self.informed = time.monotonic()
                if not check(reply):
                    raise Trouble("12 V A went off by itself")
        self.driven += TICK_S

    def look_at_motors(self, right, left, charge):
        now = time.monotonic()
        self.moved(right, left)
        if charge < 100:
            raise Trouble(f"the charge is down to {charge / 10} %")
        wanted = [duty * RPM_PER_DUTY for duty in (self.right, self.left)]
        if all(abs(rpm - own) < 0.4 * abs(own) for rpm, own in zip((right, left), wanted)):
            self.speeds_right = max(self.speeds_right, now)
        elif now - self.speeds_right > 1.0:
            raise Trouble(f"asked for {wanted} rpm, got right {right}, left {left}")

    def moved(self, right, left):
        """For subclasses that measure the distance."""

    def is_done(self):
        return self.driven >= DRIVE_S

    def is_deaf(self):
        now = time.monotonic()
        return now - self.heard > 0.4 or now - self.informed > 1.5

    def stop(self):
        """Asks for standstill until a reply says so."""
        for _ in range(50):
            self.link.send(SET_MOTORS, struct.pack("<hh", 0, 0))
            for command, reply in self.link.frames(time.monotonic() + TICK_S):
                if command == SET_MOTORS:
                    speeds = struct.unpack_from("<hh", reply)
                    self.moved(*speeds)
                    if speeds == (0, 0):
                        return
        print("the vehicle does not say that it stands")


def main(kind=Drive):
    path = sys.argv[1] if len(sys.argv) > 1 else os.environ["SIM_R150_PORT"]
    link = Link(path)
    drive = kind(link)
    try:
        prepare(link)
        drive.resume()
        while not drive.is_done():
            drive.tick()
            if drive.is_deaf():
                print("nothing to be heard: stop, and look how things stand")
                drive.stop()
                prepare(link)
                drive.resume()
        print("arrived")
    except Trouble as trouble:
        print(f"stopped for good: {trouble}")
    except (OSError, serial.SerialException) as error:
        # Who knows what has happened meanwhile: the vehicle is stopped, and stays so.
        print(f"stopped for good: {error}")
    while True:
        try:
            drive.stop()
            return
        except (OSError, serial.SerialException):
            link.open()


if __name__ == "__main__":
    main()
