"""The `sim` command itself: how it starts, ends, and what it leaves."""

import os
import signal
import unittest

import serial
from pymodbus.client import ModbusSerialClient

from bus import Bus


def read_register(port, unit):
    client = ModbusSerialClient(port, baudrate=38400, timeout=10, retries=0)
    assert client.connect()
    try:
        return client.read_holding_registers(0, count=1, device_id=unit).registers
    finally:
        client.close()


class Ends(unittest.TestCase):
    def test_sigterm_and_interrupt_end_it_well(self):
        for with_signal in (signal.SIGTERM, signal.SIGINT):
            with self.subTest(with_signal):
                bus = Bus("registers")
                self.assertTrue(os.path.islink(bus.port))
                self.assertEqual(bus.stop(with_signal), (0, False))

    def test_it_ends_by_itself_after_the_seconds_asked_for(self):
        bus = Bus("registers", "--seconds", "1")
        self.assertEqual(bus.ended(60), (0, False))


class Clients(unittest.TestCase):
    def setUp(self):
        self.bus = Bus("registers")
        self.addCleanup(self.bus.stop)

    def test_clients_may_come_and_go(self):
        for _ in range(3):
            self.assertEqual(read_register(self.bus.port, 1), [0])


class FreshBoot(unittest.TestCase):
    def test_nothing_written_survives_a_restart(self):
        bus = Bus("registers")
        try:
            client = ModbusSerialClient(bus.port, baudrate=38400, timeout=10, retries=0)
            self.assertTrue(client.connect())
            self.assertFalse(client.write_register(0, 7, device_id=1).isError())
            client.close()
            self.assertEqual(read_register(bus.port, 1), [7])
        finally:
            bus.stop()
        bus = Bus("registers")
        try:
            self.assertEqual(read_register(bus.port, 1), [0])
        finally:
            bus.stop()


class RelayPanel(unittest.TestCase):
    def test_the_port_listens_in_on_client_and_server(self):
        bus = Bus("relay-panel")
        self.addCleanup(bus.stop)
        heard = b""
        with serial.Serial(bus.port, baudrate=38400, timeout=1) as port:
            # A button is pressed every two seconds, and the state is read in between.
            for _ in range(60):
                heard += port.read(64)
                toggles = [heard.count(bytes([1, 6, 0, relay, 3, 0])) for relay in (1, 2)]
                if min(toggles) >= 2:
                    break
        # Each is heard from the client, and again as the answer of the server.
        self.assertGreaterEqual(min(toggles), 2, heard.hex(" "))
        self.assertIn(bytes.fromhex("01 03 0001 0002"), heard)
        states = {heard[at + 3 : at + 7] for at in range(len(heard)) if heard[at:].startswith(b"\1\3\4")}
        self.assertGreater(len(states), 1, "no relay has moved")


if __name__ == "__main__":
    unittest.main()
