"""Clients on pyserial: plain, threaded, asyncio, and over the network. session.py KIND PORT

Each reads the version, drives, changes the speed and back, closes and opens again.
"""

import asyncio
import queue
import sys
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


def session(port, name):
    """A whole session on an open port."""
    ask(port, VERSION, 14)
    for _ in range(5):
        ask(port, DRIVE, 14)
        time.sleep(0.06)
    ask(port, STOP, 14)
    # Of the network, bytes alone have no speed.
    if not name.startswith("socket:"):
        at_a_wrong_speed(port)


def at_a_wrong_speed(port):
    port.baudrate = 9600
    port.timeout = 0.3
    port.write(VERSION)
    assert b"\xaa\x55\x08\xf0" not in port.read(64), "a reply at the wrong speed"
    port.baudrate = 115200
    port.timeout = 5
    time.sleep(0.1)
    port.reset_input_buffer()
    ask(port, VERSION, 14)


def plain(name):
    for _ in range(2):
        with serial.serial_for_url(name, 115200, timeout=5) as port:
            session(port, name)
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


def adapter(name):
    """A port that answers for its lines as a three-wire cable does."""
    for _ in range(2):
        with serial.Serial(name, 115200, timeout=5, dsrdtr=True) as port:
            session(port, name)
            for on in (False, True):
                port.rts = on
                port.dtr = on
                assert port.cts and port.dsr and port.cd
            ask(port, HEARTBEAT, 7)


class ByThread:
    """A port that is read by a thread, as one that is asked."""

    def __init__(self, thread, heard):
        self.thread, self.heard, self.timeout = thread, heard, 5

    def write(self, data):
        self.thread.write(data)

    def read(self, length):
        data, deadline = b"", time.monotonic() + self.timeout
        while len(data) < length:
            try:
                data += self.heard.get(timeout=max(0, deadline - time.monotonic()))
            except queue.Empty:
                break
        return data

    def reset_input_buffer(self):
        while not self.heard.empty():
            self.heard.get()

    @property
    def baudrate(self):
        return self.thread.serial.baudrate

    @baudrate.setter
    def baudrate(self, baudrate):
        self.thread.serial.baudrate = baudrate


def threaded(name):
    for _ in range(2):
        heard = queue.Queue()

        class Listener(serial.threaded.Protocol):
            def data_received(self, data):
                heard.put(data)

        thread = serial.threaded.ReaderThread(
            serial.serial_for_url(name, 115200, timeout=1), Listener
        )
        with thread:
            session(ByThread(thread, heard), name)


class ByLoop:
    """A port of asyncio, as one that is asked."""

    def __init__(self, loop, reader, writer):
        self.loop, self.reader, self.writer, self.timeout = loop, reader, writer, 5

    def write(self, data):
        self.writer.write(data)

    def read(self, length):
        data = b""

        async def more():
            nonlocal data
            while len(data) < length:
                data += await self.reader.read(length - len(data))

        try:
            self.loop.run_until_complete(asyncio.wait_for(more(), self.timeout))
        except asyncio.TimeoutError:
            pass
        return data

    def reset_input_buffer(self):
        timeout, self.timeout = self.timeout, 0.05
        self.read(1000)
        self.timeout = timeout

    @property
    def baudrate(self):
        return self.writer.transport.serial.baudrate

    @baudrate.setter
    def baudrate(self, baudrate):
        self.writer.transport.serial.baudrate = baudrate


def asynchronous(name):
    import serial_asyncio

    for _ in range(2):
        loop = asyncio.new_event_loop()
        opening = serial_asyncio.open_serial_connection(url=name, baudrate=115200)
        reader, writer = loop.run_until_complete(opening)
        session(ByLoop(loop, reader, writer), name)
        writer.close()
        # The loop closes the port at its next turn.
        loop.run_until_complete(asyncio.sleep(0.1))
        loop.close()


if __name__ == "__main__":
    kinds = {
        "plain": plain,
        "threaded": threaded,
        "asyncio": asynchronous,
        "adapter": adapter,
    }
    kinds[sys.argv[1]](sys.argv[2])
