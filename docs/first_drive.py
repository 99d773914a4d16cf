#!/usr/bin/env python3
"""A first drive: python3 first_drive.py /tmp/r150 (needs `pip install pyserial`)."""
import struct, sys, time, serial

def crc16(data):  # CRC-16/X-25 over command and parameters
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return struct.pack("<H", crc ^ 0xFFFF)

def ask(port, command, parameters=b"", timeout=2.0):
    """Sends a request; the reply's parameters, or None if no valid one came in time."""
    body = bytes([command]) + parameters
    port.reset_input_buffer()  # a late reply to an earlier request is not the answer to this one
    port.timeout = timeout
    port.write(b"\xAA\x55" + bytes([len(parameters)]) + body + crc16(body))
    head = port.read(4)
    tail = port.read(head[2] + 2) if len(head) == 4 and head[3] == command else b""
    return tail[:-2] if tail and crc16(head[3:] + tail[:-2]) == tail[-2:] else None

with serial.Serial(sys.argv[1], 115200) as port:
    print("hardware %08x, software %08x" % struct.unpack("<II", ask(port, 0xF0)))
    assert ask(port, 0x02, struct.pack("<I", 1 << 0)) == b"\x01", "12 V A did not switch on"
    info = ask(port, 0x06)
    print("12 V A reads %d mV, rails that are on: %#04x" % (struct.unpack_from("<I", info)[0], info[54]))
    speed = (0, 0)
    for _ in range(40):  # two seconds at 20 Hz; the reply to one that comes too soon is held back
        due = time.monotonic() + 0.05
        reply = ask(port, 0x12, struct.pack("<hh", 1000, 1000), timeout=0.04)
        speed = struct.unpack_from("<hh", reply) if reply else speed
        time.sleep(max(0.0, due - time.monotonic()))
    print("at full speed: right %d rpm, left %d rpm" % speed)
    time.sleep(1.5)  # silence: after 500 ms the watchdog stops the motors
    rpm = struct.unpack_from("<hh", ask(port, 0x12, struct.pack("<hh", 0, 0)))
    print("after a pause: right %d rpm, left %d rpm" % rpm)
    assert info[54] == 0x01 and all(1468 < rpm < 1558 for rpm in speed) and rpm == (0, 0)
