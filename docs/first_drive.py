#!/usr/bin/env python3
"""A first drive with pyserial: python3 first_drive.py /tmp/r150 (needs `pip install pyserial`)."""
import struct, sys, time, serial

def crc16(data):  # CRC-16/X-25 over command and parameters
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return crc ^ 0xFFFF

def send(port, command, parameters=b""):
    body = bytes([command]) + parameters
    port.write(b"\xAA\x55" + bytes([len(parameters)]) + body + struct.pack("<H", crc16(body)))

def receive(port):
    """The reply's parameters, or None if nothing came within the port's timeout."""
    head = port.read(4)
    rest = port.read(head[2] + 2) if len(head) == 4 else b""
    return rest[:-2] if rest and struct.unpack("<H", rest[-2:])[0] == crc16(head[3:] + rest[:-2]) else None

with serial.Serial(sys.argv[1], 115200, timeout=0.04) as port:
    send(port, 0xF0)
    print("hardware %08x, software %08x" % struct.unpack("<II", receive(port)))
    send(port, 0x02, struct.pack("<I", 1 << 0))  # 12 V output A on
    assert receive(port) == b"\x01", "power control failed"
    send(port, 0x06)
    info = receive(port)
    print("supply %d mV, 12 V A %d mV, rails on %#04x" % (*struct.unpack_from("<16xI", info), *struct.unpack_from("<I", info), info[54]))
    for _ in range(40):  # two seconds at 20 Hz
        send(port, 0x12, struct.pack("<hh", 1000, 1000))
        started, reply = time.monotonic(), receive(port)
        rpm = struct.unpack_from("<hh", reply) if reply else rpm
        time.sleep(max(0.0, started + 0.05 - time.monotonic()))
    print("right %d rpm, left %d rpm" % rpm)
    time.sleep(1.5)  # no commands: the watchdog stops the motors after 500 ms
    send(port, 0x12, struct.pack("<hh", 0, 0))
    print("after the pause: right %d rpm, left %d rpm" % struct.unpack_from("<hh", receive(port)))
