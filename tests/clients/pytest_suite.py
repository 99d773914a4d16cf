"""Several tests in one run of pytest, each with the port for itself."""
import os
import time

import pytest
import serial


@pytest.fixture
def port():
    with serial.Serial(os.environ["SIM_R150_PORT"], 115200, timeout=0.5) as port:
        yield port


def test_silence_takes_as_long_as_the_timeout(port):
    begun = time.monotonic()
    assert port.read(1) == b""
    assert time.monotonic() - begun == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("times", range(3))
def test_the_module_answers(port, times):
    port.write(b"\xAA\x55\x00\x07\xc7\x84")
    assert port.read(7)[:5] == b"\xAA\x55\x01\x07\x01"


def test_a_sleep_is_as_long_as_it_says(port):
    begun = time.time()
    time.sleep(1)
    assert time.time() - begun == pytest.approx(1, abs=1e-3)
