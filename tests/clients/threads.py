"""Drives with one thread, listens with another, and opens the port again when it is gone."""
import os
import struct
import threading
import time

import serial


def frame(command, parameters=b""):
    crc = 0xFFFF
    for byte in bytes([command]) + parameters:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    body = bytes([len(parameters), command]) + parameters
    return b"\xAA\x55" + body + struct.pack("<H", crc ^ 0xFFFF)


def connect():
    while True:
        try:
            return serial.Serial(os.environ["SIM_R150_PORT"], 115200, timeout=0.1)
        except (OSError, serial.SerialException):
            time.sleep(0.03)


class Listener(threading.Thread):
    def __init__(self, port):
        super().__init__(daemon=True)
        self.port, self.count, self.lost = port, 0, threading.Event()
        self.start()

    def run(self):
        try:
            while True:
                self.count += len(self.port.read(14))
        except (OSError, TypeError, serial.SerialException):
            self.lost.set()


start, total, losses = time.monotonic(), 0, 0
port = connect()
listener = Listener(port)
while time.monotonic() < start + 2.5:
    try:
        port.write(frame(0x12, struct.pack("<hh", 300, 300)))
        gone = listener.lost.wait(0.1)
    except (OSError, serial.SerialException):
        gone = True
    if gone:
        total, losses = total + listener.count, losses + 1
        port.close()
        port = connect()
        listener = Listener(port)
        print("came back at", round(time.monotonic() - start, 6))
port.write(frame(0x12, bytes(4)))
time.sleep(0.2)
print("processors", os.cpu_count())
print("bytes", total + listener.count, "losses", losses)
