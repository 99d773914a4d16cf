"""A client of a common shape: four threads on one port of an R150.

    python four_threads.py [SECONDS]

One reads what there is with a timeout of 50 ms, one sends motor commands every 60 ms, one asks for the state
four times a second, and the first sleeps 20 ms at a time until it is over.
"""
import os
import struct
import sys
import threading
import time

import serial

SYSTEM_INFO, SET_MOTORS = 0x06, 0x12

span = float(sys.argv[1]) if len(sys.argv) > 1 else 90.0
port = serial.Serial(os.environ["SIM_R150_PORT"], 115200, timeout=0.05)
lock = threading.Lock()
over = threading.Event()
received = reads = 0


def crc16(data):  # CRC-16/X-25 over command and parameters
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return struct.pack("<H", crc ^ 0xFFFF)


def send(command, parameters=b""):
    body = bytes([command]) + parameters
    with lock:
        port.write(b"\xAA\x55" + bytes([len(parameters)]) + body + crc16(body))


def read():
    global received, reads
    while not over.is_set():
        received += len(port.read(max(1, port.in_waiting)))
        reads += 1


def drive():
    while not over.is_set():
        send(SET_MOTORS, struct.pack("<hh", 300, 300))
        time.sleep(0.06)


def monitor():
    while not over.is_set():
        send(SYSTEM_INFO)
        over.wait(0.25)


threads = [threading.Thread(target=each) for each in (read, drive, monitor)]
for thread in threads:
    thread.start()
end = time.monotonic() + span
while time.monotonic() < end:
    time.sleep(0.02)
over.set()
for thread in threads:
    thread.join()
print(f"{received} bytes in {reads} reads")
