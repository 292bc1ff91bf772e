"""pymodbus, as its authors publish it, against the firmware on the simulated bus."""

import random
import time
import unittest

from pymodbus.client import ModbusSerialClient
from pymodbus.exceptions import ModbusIOException
from pymodbus.framer import FramerRTU

from bus import Bus

# Silence between frames of different units: t3.5 is 1.75 ms (SER 2.5.1.1), and pymodbus keeps none.
BETWEEN_FRAMES_S = 0.005
# SER 2.4.1: after a broadcast the client gives the servers time to act.
TURNAROUND_S = 0.1

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3


def bits_of(value):
    """The 16 coils that show a register, coil 0 first."""
    return [bool(value >> bit & 1) for bit in range(16)]


class OnBus(unittest.TestCase):
    """A bus and a client for the tests of a class."""

    scenario = None

    @classmethod
    def setUpClass(cls):
        cls.bus = Bus(cls.scenario)
        cls.addClassCleanup(cls.bus.stop)

    def setUp(self):
        self.sent = []
        self.replace = None
        self.client = ModbusSerialClient(
            self.bus.port,
            baudrate=38400,
            timeout=10,
            # A lost answer must show as one, not be mended by a second try.
            retries=0,
            trace_packet=self.trace,
        )
        self.assertTrue(self.client.connect())
        self.addCleanup(self.client.close)
        time.sleep(BETWEEN_FRAMES_S)

    def trace(self, sending, packet):
        if not sending:
            return packet
        if self.replace is not None:
            packet = self.replace(packet)
        self.sent.append(packet)
        return packet

    def with_pdu(self, pdu):
        """Puts `pdu` in place of what pymodbus would send, which refuses to send nonsense."""

        def replace(packet):
            body = packet[:1] + pdu
            return body + FramerRTU.compute_CRC(body).to_bytes(2, "big")

        self.replace = replace

    def assert_exception(self, response, function, code):
        self.assertTrue(response.isError(), response)
        self.assertEqual((response.function_code, response.exception_code), (function | 0x80, code))


class DemoUnit(OnBus):
    """Three units, each one register seen through all four tables."""

    scenario = "demo-unit"

    def test_500_transactions_of_all_eight_functions_and_none_lost(self):
        client, unit = self.client, {"device_id": 2}
        chance = random.Random(1)
        value = 0
        self.assertFalse(client.write_register(0, value, **unit).isError())
        self.sent.clear()
        for number in range(500):
            kind = number % 8
            first = chance.randrange(16)
            count = chance.randrange(1, 17 - first)
            bits = bits_of(value)
            with self.subTest(number=number, kind=kind):
                if kind == 0:
                    answer = client.read_coils(first, count=count, **unit)
                    self.assertEqual(answer.bits[:count], bits[first : first + count])
                elif kind == 1:
                    answer = client.read_discrete_inputs(first, count=count, **unit)
                    self.assertEqual(answer.bits[:count], bits[first : first + count])
                elif kind == 2:
                    answer = client.read_holding_registers(0, count=1, **unit)
                    self.assertEqual(answer.registers, [value])
                elif kind == 3:
                    answer = client.read_input_registers(0, count=1, **unit)
                    self.assertEqual(answer.registers, [value])
                elif kind == 4:
                    bits[first] = chance.random() < 0.5
                    answer = client.write_coil(first, bits[first], **unit)
                elif kind == 5:
                    bits = bits_of(chance.randrange(0x10000))
                    value = sum(bit << place for place, bit in enumerate(bits))
                    answer = client.write_register(0, value, **unit)
                elif kind == 6:
                    written = [chance.random() < 0.5 for _ in range(count)]
                    bits[first : first + count] = written
                    answer = client.write_coils(first, written, **unit)
                else:
                    bits = bits_of(chance.randrange(0x10000))
                    value = sum(bit << place for place, bit in enumerate(bits))
                    answer = client.write_registers(0, [value], **unit)
                self.assertFalse(answer.isError(), answer)
                value = sum(bit << place for place, bit in enumerate(bits))
        self.assertEqual(len(self.sent), 500)
        functions = {packet[1] for packet in self.sent}
        self.assertEqual(functions, {0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F, 0x10})

    def test_units_keep_their_own_register(self):
        for unit in (1, 2, 3):
            self.assertFalse(self.client.write_register(0, 0x1000 + unit, device_id=unit).isError())
            time.sleep(BETWEEN_FRAMES_S)
        for unit in (1, 2, 3):
            answer = self.client.read_holding_registers(0, count=1, device_id=unit)
            self.assertEqual(answer.registers, [0x1000 + unit])
            time.sleep(BETWEEN_FRAMES_S)

    def test_a_broadcast_reaches_every_unit_and_nobody_answers(self):
        self.client.write_register(0, 0xA5F0, device_id=0, no_response_expected=True)
        time.sleep(TURNAROUND_S)
        self.assertEqual(self.client.socket.in_waiting, 0)
        for unit in (1, 2, 3):
            answer = self.client.read_holding_registers(0, count=1, device_id=unit)
            self.assertEqual(answer.registers, [0xA5F0])
            time.sleep(BETWEEN_FRAMES_S)

    def test_addresses_past_the_one_register_are_refused(self):
        client, unit = self.client, {"device_id": 2}
        self.assert_exception(client.read_holding_registers(1, **unit), 0x03, ILLEGAL_ADDRESS)
        self.assert_exception(client.read_input_registers(0, count=2, **unit), 0x04, ILLEGAL_ADDRESS)
        self.assert_exception(client.read_coils(1, count=16, **unit), 0x01, ILLEGAL_ADDRESS)
        self.assert_exception(client.read_discrete_inputs(16, **unit), 0x02, ILLEGAL_ADDRESS)
        self.assert_exception(client.write_coil(16, True, **unit), 0x05, ILLEGAL_ADDRESS)
        self.assert_exception(client.write_register(1, 0, **unit), 0x06, ILLEGAL_ADDRESS)
        self.assert_exception(client.write_coils(15, [True, True], **unit), 0x0F, ILLEGAL_ADDRESS)
        self.assert_exception(client.write_registers(0, [1, 2], **unit), 0x10, ILLEGAL_ADDRESS)

    def test_a_refused_write_changes_nothing(self):
        client, unit = self.client, {"device_id": 2}
        self.assertFalse(client.write_register(0, 0x0F0F, **unit).isError())
        self.assertTrue(client.write_registers(0, [0xFFFF, 0xFFFF], **unit).isError())
        self.assertTrue(client.write_coils(8, [True] * 9, **unit).isError())
        answer = client.read_holding_registers(0, count=1, **unit)
        self.assertEqual(answer.registers, [0x0F0F])

    def test_a_function_that_is_not_there_is_refused(self):
        answer = self.client.mask_write_register(
            address=0, and_mask=0xFFFF, or_mask=0, device_id=2
        )
        self.assert_exception(answer, 0x16, ILLEGAL_FUNCTION)

    def test_malformed_requests_are_refused(self):
        client = self.client
        for pdu in (
            "05 0000 1234",  # neither on nor off
            "05 0000 00FF",
        ):
            with self.subTest(pdu):
                self.with_pdu(bytes.fromhex(pdu))
                self.assert_exception(
                    client.write_coil(0, True, device_id=2), 0x05, ILLEGAL_VALUE
                )
        for pdu in (
            "03 0000 0000",  # none
            "03 0000 007E",  # 126, one more than fit
            "03 0000 0001 00",  # one byte too long
        ):
            with self.subTest(pdu):
                self.with_pdu(bytes.fromhex(pdu))
                self.assert_exception(
                    client.read_holding_registers(0, device_id=2), 0x03, ILLEGAL_VALUE
                )
        for pdu in (
            "10 0000 0001 04 0001 0002",  # quantity and byte count differ
            "10 0000 0000 00",
        ):
            with self.subTest(pdu):
                self.with_pdu(bytes.fromhex(pdu))
                self.assert_exception(
                    client.write_registers(0, [1], device_id=2), 0x10, ILLEGAL_VALUE
                )

    def test_a_unit_that_is_not_there_is_a_timeout_and_the_next_request_is_answered(self):
        self.client.comm_params.timeout_connect = 0.2
        with self.assertRaises(ModbusIOException):
            self.client.read_holding_registers(0, device_id=9)
        self.client.comm_params.timeout_connect = 10
        self.assertFalse(self.client.read_holding_registers(0, device_id=2).isError())

    def test_a_wrong_crc_is_not_answered(self):
        self.client.comm_params.timeout_connect = 0.2
        self.replace = lambda packet: packet[:-1] + bytes([packet[-1] ^ 1])
        with self.assertRaises(ModbusIOException):
            self.client.read_holding_registers(0, device_id=2)


class Registers(OnBus):
    """The yardstick image: 16 of each table."""

    scenario = "registers"

    def test_the_tables_boot_as_promised(self):
        client, unit = self.client, {"device_id": 1}
        inputs = client.read_input_registers(0, count=16, **unit)
        self.assertEqual(inputs.registers, [0x1000 + address for address in range(16)])
        discrete = client.read_discrete_inputs(0, count=16, **unit)
        self.assertEqual(discrete.bits[:16], [address % 3 == 0 for address in range(16)])

    def test_blocks_are_written_and_read_whole(self):
        client, unit = self.client, {"device_id": 1}
        values = [address * 0x0101 for address in range(1, 17)]
        self.assertFalse(client.write_registers(0, values, **unit).isError())
        self.assertEqual(client.read_holding_registers(0, count=16, **unit).registers, values)
        coils = [address % 5 < 2 for address in range(16)]
        self.assertFalse(client.write_coils(0, coils, **unit).isError())
        self.assertEqual(client.read_coils(0, count=16, **unit).bits[:16], coils)

    def test_the_tables_end_at_their_count(self):
        client, unit = self.client, {"device_id": 1}
        self.assertFalse(client.read_holding_registers(15, **unit).isError())
        self.assert_exception(client.read_holding_registers(16, **unit), 0x03, ILLEGAL_ADDRESS)
        self.assert_exception(client.read_coils(10, count=7, **unit), 0x01, ILLEGAL_ADDRESS)


if __name__ == "__main__":
    unittest.main()
