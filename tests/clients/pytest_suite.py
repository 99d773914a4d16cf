"""Several tests in one run of pytest, each with the port for itself."""
import os
import time

import pytest
import serial


def connect():
    return serial.Serial(os.environ["SIM_R150_PORT"], 115200, timeout=0.5)


@pytest.fixture
def port():
    with connect() as port:
        yield port


def test_silence_takes_as_long_as_the_timeout(port):
    begun = time.monotonic()
    assert port.read(1) == b""
    assert time.monotonic() - begun == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("times", range(3))
def test_the_module_answers(port, times):
    port.write(b"\xAA\x55\x00\x07\xc7\x84")
    assert port.read(7)[:5] == b"\xAA\x55\x01\x07\x01"


def test_the_cable_comes_back():
    with pytest.raises(serial.SerialException), connect() as port:
        while True:
            port.write(b"\xAA\x55\x00\x07\xc7\x84")
            port.read(7)
    begun = time.monotonic()
    while not os.path.exists(os.environ["SIM_R150_PORT"]):
        time.sleep(0.03)
    with connect() as port:
        print("came back after", round(time.monotonic() - begun, 6))
        assert port.read(1) == b""


def test_a_sleep_is_as_long_as_it_says(port):
    begun = time.time()
    time.sleep(1)
    assert time.time() - begun == pytest.approx(1, abs=1e-3)
    print("processors", os.cpu_count())
