"""Clients on pyserial: plain, threaded, asyncio, and over the network. session.py KIND PORT

Reads the version, drives, changes the speed and back, closes and opens again.
"""

import asyncio
import sys
import threading
import time

import serial
import serial.threaded

VERSION = bytes.fromhex("AA5500F0F707")
HEARTBEAT = bytes.fromhex("AA550007C784")



def crc(data):
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0x8408 if value & 1 else 0)
    return value ^ 0xFFFF


def frame(command, parameters=b""):
    body = bytes([command]) + parameters
    return bytes([0xAA, 0x55, len(parameters)]) + body + crc(body).to_bytes(2, "little")


DRIVE = frame(0x12, (200).to_bytes(2, "little") * 2)
STOP = frame(0x12, bytes(4))
assert frame(0xF0) == VERSION and frame(0x07) == HEARTBEAT


def ask(port, request, length):
    port.write(request)
    reply = port.read(length)
    assert len(reply) == length, f"{reply.hex(' ')} to {request.hex(' ')}"
    assert reply[:2] == b"\xaa\x55" and reply[3] == request[3], reply.hex(" ")
    return reply


def session(port):
    """A whole session on an open port."""
    ask(port, VERSION, 14)
    for _ in range(5):
        ask(port, DRIVE, 14)
        time.sleep(0.06)
    ask(port, STOP, 14)


def at_a_wrong_speed(port):
    port.baudrate = 9600
    port.timeout = 0.3
    port.write(VERSION)
    assert VERSION[:4] not in port.read(64), "a reply at the wrong speed"
    port.baudrate = 115200
    port.timeout = 5
    time.sleep(0.1)
    port.reset_input_buffer()
    ask(port, VERSION, 14)


def plain(name):
    for round in range(2):
        with serial.serial_for_url(name, 115200, timeout=5) as port:
            session(port)
            if not name.startswith("socket:"):
                at_a_wrong_speed(port)
            if name.startswith("rfc2217:"):
                lines(port)


def lines(port):
    """What a pseudo-terminal does not have."""
    for on in (False, True):
        port.rts = on
        port.dtr = on
        deadline = time.monotonic() + 5
        while (port.cts, port.dsr, port.cd) != (on, on, on):
            assert time.monotonic() < deadline, f"the lines do not follow: {on}"
            time.sleep(0.02)
    port.send_break(0.01)
    port.reset_output_buffer()
    port.parity = serial.PARITY_EVEN
    port.parity = serial.PARITY_NONE
    time.sleep(0.1)
    port.reset_input_buffer()
    ask(port, HEARTBEAT, 7)


def threaded(name):
    for round in range(2):
        done = threading.Event()

        class Listener(serial.threaded.Protocol):
            heard = b""

            def data_received(self, data):
                self.heard += data
                if len(self.heard) >= 14:
                    done.set()

        port = serial.serial_for_url(name, 115200, timeout=1)
        thread = serial.threaded.ReaderThread(port, Listener)
        with thread as protocol:
            thread.write(VERSION)
            assert done.wait(5), "no reply"
            assert protocol.heard[3] == 0xF0, protocol.heard.hex(" ")


def asynchronous(name):
    import serial_asyncio

    async def talk():
        reader, writer = await serial_asyncio.open_serial_connection(url=name, baudrate=115200)
        for _ in range(3):
            writer.write(VERSION)
            reply = await asyncio.wait_for(reader.readexactly(14), 5)
            assert reply[3] == 0xF0, reply.hex(" ")
        writer.close()

    for round in range(2):
        asyncio.run(talk())


if __name__ == "__main__":
    {"plain": plain, "threaded": threaded, "asyncio": asynchronous}[sys.argv[1]](sys.argv[2])
