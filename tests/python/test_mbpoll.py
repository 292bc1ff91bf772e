"""mbpoll, as Debian ships it, against the demonstration unit."""

import re
import subprocess
import unittest

from bus import Bus

# mbpoll's names for the four tables.
COILS, DISCRETE_INPUTS, INPUT_REGISTERS, HOLDING_REGISTERS = "0", "1", "3:hex", "4:hex"


class OnBus(unittest.TestCase):
    """A bus for the tests of a class, and mbpoll's command line."""

    scenario, unit = None, None

    @classmethod
    def setUpClass(cls):
        cls.bus = Bus(cls.scenario)
        cls.addClassCleanup(cls.bus.stop)

    def mbpoll(self, table, *options, values=()):
        """Runs one poll with wire addresses; gives the exit code and all it printed."""
        line = ["mbpoll", "-m", "rtu", "-b", "38400", "-d", "8", "-s", "1", "-P", "none"]
        line += ["-a", self.unit, "-0", "-1", "-o", "2", "-t", table, *options, self.bus.port]
        line += values
        done = subprocess.run(line, capture_output=True, text=True, timeout=30, check=False)
        return done.returncode, done.stdout + done.stderr

    def read(self, table, first=0, count=1):
        code, said = self.mbpoll(table, "-r", str(first), "-c", str(count))
        self.assertEqual(code, 0, said)
        found = re.findall(r"^\[(\d+)\]:\s+(0x[0-9A-F]+|\d+)", said, re.MULTILINE)
        self.assertEqual([int(place) for place, _ in found], list(range(first, first + count)))
        return [int(value, 0) for _, value in found]

    def write(self, table, *values, first=0):
        code, said = self.mbpoll(table, "-r", str(first), values=values)
        self.assertEqual(code, 0, said)

    def refused(self, table, *options, values=()):
        code, said = self.mbpoll(table, *options, values=values)
        self.assertNotEqual(code, 0, said)
        return said


class DemoUnit(OnBus):
    """The second of three units: one register seen through all four tables."""

    scenario, unit = "demo-unit", "2"

    def test_the_register_is_seen_through_all_four_tables(self):
        # FC 06, then 03, 04, 01, 02.
        self.write(HOLDING_REGISTERS, "0xA5C3")
        self.assertEqual(self.read(HOLDING_REGISTERS), [0xA5C3])
        self.assertEqual(self.read(INPUT_REGISTERS), [0xA5C3])
        bits = [0xA5C3 >> bit & 1 for bit in range(16)]
        self.assertEqual(self.read(COILS, count=16), bits)
        self.assertEqual(self.read(DISCRETE_INPUTS, count=16), bits)

    def test_coils_one_by_one_and_several(self):
        # FC 06, 05, 0F.
        self.write(HOLDING_REGISTERS, "0")
        self.write(COILS, "1", first=9)
        self.assertEqual(self.read(HOLDING_REGISTERS), [0x0200])
        self.write(COILS, "1", "0", "1", "1", first=4)
        self.assertEqual(self.read(HOLDING_REGISTERS), [0x02D0])

    def test_exceptions_are_named(self):
        self.assertIn("Illegal data address", self.refused(HOLDING_REGISTERS, "-r", "1"))
        said = self.refused(HOLDING_REGISTERS, "-r", "0", values=["1", "2"])
        self.assertIn("Illegal data address", said)


class Registers(OnBus):
    """The yardstick image, for writes of several registers."""

    scenario, unit = "registers", "1"

    def test_several_registers_at_once(self):
        # FC 10.
        self.write(HOLDING_REGISTERS, "258", "772", "65535", first=13)
        self.assertEqual(self.read(HOLDING_REGISTERS, 13, 3), [0x0102, 0x0304, 0xFFFF])


if __name__ == "__main__":
    unittest.main()
