"""A child drives, and its parent waits for what it says: with_processes.py multiprocessing|subprocess"""
import multiprocessing
import os
import queue
import subprocess
import sys
import time

import serial


def connect():
    while True:
        try:
            return serial.Serial(os.environ["SIM_R150_PORT"], 115200, timeout=0.1)
        except (OSError, serial.SerialException):
            time.sleep(0.03)


def drive(say):
    begun, port, count = time.monotonic(), connect(), 0
    while time.monotonic() < begun + 2.5:
        try:
            port.write(bytes.fromhex("aa5504122c012c011eb4"))
            count += len(port.read(64))
        except (OSError, serial.SerialException):
            port.close()
            port = connect()
            say(f"came back at {time.monotonic() - begun:.6f}")
    say(f"bytes {count}")


def by_multiprocessing():
    said = multiprocessing.Queue()
    child = multiprocessing.Process(target=drive, args=(said.put,))
    child.start()
    waits = 0
    while child.is_alive() or not said.empty():
        try:
            print(said.get(timeout=0.2), flush=True)
        except queue.Empty:
            waits += 1
    child.join()
    print("waits", waits)


def by_subprocess():
    words = [sys.executable, __file__, "child"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as child:
        for line in child.stdout:
            print(line, end="", flush=True)
    print("ended with", child.wait(timeout=1))


if __name__ == "__main__":
    kind = sys.argv[1]
    if kind == "child":
        drive(lambda line: print(line, flush=True))
    else:
        {"multiprocessing": by_multiprocessing, "subprocess": by_subprocess}[kind]()
        print("processors", os.cpu_count())
