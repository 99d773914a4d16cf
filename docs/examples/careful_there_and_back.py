#!/usr/bin/env python3
"""The careful car client, to the far corner and back the same way.

    sim run --job docs/examples/there-and-back.toml scenarios/mecanum/faults \\
        -- python3 docs/examples/careful_there_and_back.py

Needs `pip install pyserial`. All its care is careful_car_client.py's.
"""
from careful_car_client import main

main([("x", 30, False), ("y", 10, False), ("y", 0, True), ("x", 0, True)])
