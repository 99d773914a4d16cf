"""The R150's frames on sinstruments, for comparison: python sinstruments_device.py FOLDER COUNT

Serves COUNT devices on pseudo-terminals FOLDER/r150-0, FOLDER/r150-1, ... and prints `ready` once
clients can connect. It finds frames, checks them and answers three commands; nothing moves behind
it, and no line is paced.
"""

import os
import struct
import sys

from sinstruments.simulator import BaseDevice, MessageProtocol, Server

HEADER = b"\xaa\x55"
HEARTBEAT, SYSTEM_INFO, SET_MOTORS = 0x07, 0x06, 0x12


def crc_table():
    table = []
    for value in range(256):
        for _ in range(8):
            value = (value >> 1) ^ (0x8408 if value & 1 else 0)
        table.append(value)
    return table


CRC_TABLE = crc_table()


def crc(data):
    value = 0xFFFF
    for byte in data:
        value = (value >> 8) ^ CRC_TABLE[(value ^ byte) & 0xFF]
    return value ^ 0xFFFF


class FrameProtocol(MessageProtocol):
    def read_messages(self):
        held = b""
        while True:
            read = self.transport.read1(self.channel)
            if not read:
                return
            held += read
            while True:
                start = held.find(HEADER)
                if start < 0:
                    held = held[-1:]
                    break
                held = held[start:]
                if len(held) < 4 or len(held) < 6 + held[2]:
                    break
                end = 4 + held[2]
                body, trailer = held[3:end], held[end : end + 2]
                if crc(body) == int.from_bytes(trailer, "little"):
                    held = held[end + 2 :]
                    yield body
                else:
                    held = held[1:]


class R150(BaseDevice):
    protocol = FrameProtocol

    def __init__(self, name, **options):
        super().__init__(name, **options)
        self.motors = (0, 0)

    def handle_message(self, message):
        command, parameters = message[0], message[1:]
        if command == HEARTBEAT:
            reply = b"\x01"
        elif command == SYSTEM_INFO:
            reply = struct.pack("<19I", *range(19))
        elif command == SET_MOTORS and len(parameters) == 4:
            self.motors = struct.unpack("<hh", parameters)
            reply = struct.pack("<hhHH", *self.motors, 800, 0)
        else:
            return None
        body = bytes([command]) + reply
        return HEADER + bytes([len(reply)]) + body + crc(body).to_bytes(2, "little")


def main():
    folder, count = sys.argv[1], int(sys.argv[2])
    names = [f"r150-{index}" for index in range(count)]
    devices = [
        {
            "class": "R150",
            "package": __name__,
            "name": name,
            "transports": [{"type": "serial", "url": os.path.join(folder, name)}],
        }
        for name in names
    ]
    server = Server(devices=devices)
    if len(server.devices) != count:
        sys.exit("not every device could be made")
    print("ready", flush=True)
    server.serve_forever()


if __name__ == "__main__":
    main()
