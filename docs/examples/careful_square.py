#!/usr/bin/env python3
"""The careful client, around a square of 3 m.

    sim run --job docs/examples/square.toml scenarios/r150/faults -- python3 docs/examples/careful_square.py

Needs `pip install pyserial`. All its care is careful_client.py's.
"""
import time

from careful_client import Drive, main
from odometry import Way


class Square(Drive):
    def __init__(self, link):
        super().__init__(link)
        self.way = Way()

    def moved(self, right, left):
        self.way.measure(time.monotonic(), right, left)

    def is_done(self):
        duties = self.way.duties()
        self.right, self.left = duties or (0, 0)
        return duties is None


main(Square)
