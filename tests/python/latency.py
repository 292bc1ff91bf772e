"""Asks a unit again and again, as a client that knows nothing of the bus, and tells how long each answer took.

usage: latency.py PORT UNIT FUNCTION COUNT

FUNCTION is 3 or 4: one register at address 0. Prints a JSON list of milliseconds; a wrong or missing answer ends it.
"""

import json
import random
import sys
import time

from pymodbus.client import ModbusSerialClient


def main():
    port, unit, function, count = sys.argv[1], *map(int, sys.argv[2:5])
    client = ModbusSerialClient(port=port, baudrate=38400, timeout=3, retries=0)
    if not client.connect():
        sys.exit(f"{port} cannot be opened")
    read = client.read_holding_registers if function == 3 else client.read_input_registers
    pauses = random.Random(1)
    spans = []
    # The first ones are slower: Python compiles.
    for turn in range(count + 10):
        time.sleep(pauses.random() * 0.02)
        start = time.perf_counter()
        answer = read(0, count=1, device_id=unit)
        span = (time.perf_counter() - start) * 1e3
        if answer.isError():
            sys.exit(f"unit {unit}, request {turn}: {answer}")
        if turn >= 10:
            spans.append(span)
    client.close()
    print(json.dumps(spans))


main()
