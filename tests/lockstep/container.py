"""Runs a program under the syscalls that containers allow by default, without a capability.

    python container.py PROGRAM ARGUMENT...

The rules are those of profiles/seccomp/default.json in github.com/moby/moby, for x86-64.
"""
import ctypes
import os
import struct
import sys

# Numbers of syscalls, from and to. Not in it are, among others, 272 unshare, 308 setns, 312 kcmp and
# 438 pidfd_getfd.
ALLOWED = [
    (0, 102), (104, 133), (137, 138), (140, 152), (154, 154), (157, 160), (162, 162), (186, 211), (213, 226),
    (228, 235), (240, 245), (247, 247), (251, 255), (257, 271), (273, 278), (280, 297), (299, 299), (301, 303),
    (305, 307), (309, 311), (314, 319), (322, 322), (324, 334), (424, 427), (434, 437), (439, 439), (441, 441),
    (444, 449),
]
PERSONALITY, PERSONAS = 135, [0, 8, 0x20000, 0x20008, 0xFFFFFFFF]
SOCKET, VSOCK = 41, 40
CLONE, NAMESPACES = 56, 0x7E020000
CLONE3 = 435
ALLOW, EPERM, ENOSYS = 0x7FFF0000, 0x00050001, 0x00050026
LOAD, EQUAL, AT_LEAST, ANY_BIT, RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
NUMBER, FIRST_ARGUMENT = 0, 16


def rule(number, value_tests, hit, miss):
    """A test of the first argument of one syscall."""
    tests = [(LOAD, 0, 0, FIRST_ARGUMENT)]
    for at, (test, value) in enumerate(value_tests):
        tests.append((test, len(value_tests) - at, 0, value))
    return [(EQUAL, 0, len(tests) + 2, number), *tests, (RETURN, 0, 0, miss), (RETURN, 0, 0, hit)]


filters = [(LOAD, 0, 0, NUMBER)]
filters += rule(PERSONALITY, [(EQUAL, persona) for persona in PERSONAS], ALLOW, EPERM)
filters += rule(SOCKET, [(EQUAL, VSOCK)], EPERM, ALLOW)
filters += rule(CLONE, [(ANY_BIT, NAMESPACES)], EPERM, ALLOW)
filters += [(EQUAL, 0, 1, CLONE3), (RETURN, 0, 0, ENOSYS)]
for first, last in ALLOWED:
    filters += [(AT_LEAST, 0, 2, first), (AT_LEAST, 1, 0, last + 1), (RETURN, 0, 0, ALLOW)]
filters.append((RETURN, 0, 0, EPERM))

code = b"".join(struct.pack("HBBI", *one) for one in filters)
code = ctypes.create_string_buffer(code, len(code))
program = struct.pack("HxxxxxxP", len(filters), ctypes.addressof(code))
PR_SET_NO_NEW_PRIVS, PR_SET_SECCOMP, FILTER = 38, 22, 2
prctl = ctypes.CDLL(None, use_errno=True).prctl
if prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) or prctl(PR_SET_SECCOMP, FILTER, program, 0, 0):
    sys.exit(os.strerror(ctypes.get_errno()))
os.execvp(sys.argv[1], sys.argv[1:])
