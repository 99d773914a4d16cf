#!/usr/bin/env python3
"""Drive a vehicle so that a recording tells as many of its settings as possible.

    sim tap /dev/ttyUSB0 --pty /tmp/r150 --trace drive.jsonl --plan     # in another terminal
    python3 docs/examples/identify.py /tmp/r150

For a car: `--device mecanum /tmp/car`, with the second link behind it if there is one. Needs
`pip install pyserial`, and `sim` on the path: `sim fit --plan` has the manoeuvres. Read docs/vehicle.md
first, raise the vehicle, and have the emergency stop in your hand. Ctrl-C stops the motors and ends it.
`--only NAME` performs the manoeuvres whose name contains NAME, `--yes` asks nothing.
"""
import argparse
import json
import os
import signal
import subprocess
import time

import serial


def crc16(data):  # CRC-16/X-25 over command and parameters
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return (crc ^ 0xFFFF).to_bytes(2, "little")


def perform(ports, manoeuvre):
    """Sends the frames of a manoeuvre, each at its time, and reads what comes."""
    due = time.monotonic()
    heard = 0
    for frame in manoeuvre["frames"]:
        ports[frame["link"]].write(bytes.fromhex(frame["bytes"]))
        due += frame["wait_ms"] / 1e3
        while (rest := due - time.monotonic()) > 0:
            time.sleep(min(rest, 0.02))
            heard += sum(len(port.read(4096)) for port in ports)
    return heard


STANDSTILL = b"\x12\x00\x00\x00\x00"
# The speeds of the links, and what stops the vehicle.
DEVICES = {
    "r150": ([115200], b"\xAA\x55\x04" + STANDSTILL + crc16(STANDSTILL)),
    "mecanum": ([115200, 9600], b"\x00\x09\x00\x01\x00\x00\x00\x00\x00"),
}


def stop(ports, frame):
    """Asks for standstill, many times; another Ctrl-C does not end that."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for _ in range(20):
        ports[0].write(frame)
        time.sleep(0.06)
        for port in ports:
            port.read(4096)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("port", nargs="*", default=[os.environ.get("SIM_R150_PORT")])
    parser.add_argument("--device", choices=DEVICES, default="r150")
    parser.add_argument("--only", default="", metavar="NAME")
    parser.add_argument("--yes", action="store_true")
    parser.add_argument("--config", help="a file of settings for `sim fit --plan`, such as of a byte order")
    parser.add_argument("--plan", help="a file with the output of `sim fit --plan --json`")
    args = parser.parse_args()
    if None in args.port:
        parser.error("name the port, such as /tmp/r150, or set SIM_R150_PORT")
    if args.plan:
        with open(args.plan) as file:
            plan = json.load(file)
    else:
        command = ["sim", "fit", "--plan", "--json", "--device", args.device]
        command += ["--config", args.config] if args.config else []
        try:
            plan = json.loads(subprocess.check_output(command))
        except (OSError, subprocess.CalledProcessError) as error:
            raise SystemExit(f"no plan: {error}; put `sim` on the path, or give --plan") from None
    speeds, standstill = DEVICES[args.device]
    able = [one for one in plan if all(frame["link"] < len(args.port) for frame in one["frames"])]
    chosen = [one for one in able if args.only in one["name"]]
    if not chosen:
        names = "; ".join(one["name"] for one in able)
        parser.error(f"--only: with {len(args.port)} port(s) there are these manoeuvres: {names}")
    try:
        ports = [
            serial.Serial(path, speed, timeout=0, write_timeout=1)
            for path, speed in zip(args.port, speeds)
        ]
    except serial.SerialException as error:
        raise SystemExit(error) from None
    try:
        for manoeuvre in chosen:
            seconds = sum(frame["wait_ms"] for frame in manoeuvre["frames"]) / 1e3
            print(f"{manoeuvre['name']}, {seconds:.0f} s. {manoeuvre['care']}", flush=True)
            if not args.yes:
                input("  Enter begins it, Ctrl-C ends the drive: ")
            if not perform(ports, manoeuvre):
                raise SystemExit("the vehicle does not answer: is it on, and is the cable in?")
    except (KeyboardInterrupt, EOFError):
        print("stopped")
    except serial.SerialException as error:
        raise SystemExit(f"the port has failed: {error}") from None
    finally:
        try:
            stop(ports, standstill)
        except serial.SerialException as error:
            raise SystemExit(f"not stopped: {error}. Use the emergency stop.") from None


if __name__ == "__main__":
    main()
