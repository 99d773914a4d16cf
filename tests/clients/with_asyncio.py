"""The same with asyncio: two tasks over one descriptor."""
import asyncio
import os
import struct
import termios
import tty


def frame(command, parameters=b""):
    crc = 0xFFFF
    for byte in bytes([command]) + parameters:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    body = bytes([len(parameters), command]) + parameters
    return b"\xAA\x55" + body + struct.pack("<H", crc ^ 0xFFFF)


async def connect():
    while True:
        try:
            fd = os.open(os.environ["SIM_R150_PORT"], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            tty.setraw(fd)
            return fd
        except (OSError, termios.error):
            await asyncio.sleep(0.03)


async def drive(fd):
    while True:
        os.write(fd, frame(0x12, struct.pack("<hh", 300, 300)))
        await asyncio.sleep(0.1)


async def main():
    loop, count = asyncio.get_running_loop(), 0
    start = loop.time()
    while loop.time() < start + 2.5:
        fd, lost = await connect(), asyncio.Event()
        if count:
            print("came back at", round(loop.time() - start, 6))

        def readable():
            nonlocal count
            try:
                data = os.read(fd, 100)
            except OSError:
                data = b""
            count += len(data)
            if not data:
                loop.remove_reader(fd)
                lost.set()

        loop.add_reader(fd, readable)
        driving = asyncio.create_task(drive(fd))
        try:
            await asyncio.wait_for(lost.wait(), start + 2.5 - loop.time())
        except asyncio.TimeoutError:
            os.write(fd, frame(0x12, bytes(4)))
            await asyncio.sleep(0.2)
        driving.cancel()
        await asyncio.gather(driving, return_exceptions=True)
        loop.remove_reader(fd)
        os.close(fd)
    print("processors", len(os.sched_getaffinity(0)))
    print("bytes", count)


asyncio.run(main())
