"""pymodbus's client, with every function that it knows, against the image conformance on the simulated bus."""

import time
import unittest
from unittest import mock

from pymodbus import FramerType
from pymodbus.client import ModbusSerialClient
from pymodbus.exceptions import ModbusIOException
from pymodbus.pdu.device import ModbusControlBlock
from pymodbus.pdu.file_message import FileRecord, ReadFifoQueueResponse

from bus import Bus
from test_pymodbus import BETWEEN_FRAMES_S, TURNAROUND_S

UNIT = {"device_id": 17}
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, NACK = 1, 2, 3, 7


class Functions:
    """The tests of one framing on one board; each leaves the unit as it was at boot, its counters aside."""

    board = "nano"
    options, settings = (), {}
    # What pymodbus can have echoed.
    messages = (b"\xa5\x37", b"\x00\x00")

    @classmethod
    def setUpClass(cls):
        cls.bus = Bus(f"{cls.board}-conformance", *cls.options)
        cls.addClassCleanup(cls.bus.stop)

    def setUp(self):
        self.client = ModbusSerialClient(self.bus.port, timeout=10, retries=0, **self.settings)
        self.assertTrue(self.client.connect())
        self.addCleanup(self.client.close)
        time.sleep(BETWEEN_FRAMES_S)

    def good(self, answer):
        self.assertFalse(answer.isError(), answer)
        return answer

    def refused(self, answer, code):
        self.assertTrue(answer.isError(), answer)
        self.assertEqual(answer.exception_code, code)

    def unheard(self, send, *arguments, **options):
        """A request that is not answered."""
        send(*arguments, **options, no_response_expected=True)
        time.sleep(TURNAROUND_S)

    def counters(self):
        """Every counter of FC 08, as the reads that ask for them find it."""
        client = self.client
        reads = {
            "messages": client.diag_read_bus_message_count,
            "errors": client.diag_read_bus_comm_error_count,
            "exceptions": client.diag_read_bus_exception_error_count,
            "addressed": client.diag_read_device_message_count,
            "unanswered": client.diag_read_device_no_response_count,
            "nak": client.diag_read_device_nak_count,
            "busy": client.diag_read_device_busy_count,
            "overruns": client.diag_read_bus_char_overrun_count,
        }
        return {name: self.good(read(**UNIT)).message for name, read in reads.items()}

    def test_01_05_0f_coils(self):
        client = self.client
        self.assertEqual(self.good(client.read_coils(118, count=4, **UNIT)).bits[:4], [0, 0, 1, 0])
        bits = [place % 7 < 3 for place in range(1968)]
        self.good(client.write_coils(1000, bits, **UNIT))
        self.assertEqual(self.good(client.read_coils(1000, count=2000, **UNIT)).bits, bits + [False] * 32)
        self.good(client.write_coils(1000, [False] * 1968, **UNIT))
        self.good(client.write_coil(127, True, **UNIT))
        self.assertTrue(self.good(client.read_coils(127, **UNIT)).bits[0])
        self.good(client.write_coil(127, False, **UNIT))
        self.refused(client.read_coils(127, count=2, **UNIT), ILLEGAL_ADDRESS)

    def test_02_discrete_inputs(self):
        inputs = self.good(self.client.read_discrete_inputs(1000, count=2000, **UNIT))
        self.assertEqual(inputs.bits, [address % 3 == 0 for address in range(1000, 3000)])

    def test_03_06_10_holding_registers_and_their_rules(self):
        client = self.client
        registers = self.good(client.read_holding_registers(0, count=125, **UNIT)).registers
        self.assertEqual(registers, list(range(125)))
        values = [0xFFFF - place for place in range(100)]
        self.good(client.write_registers(0, values, **UNIT))
        self.assertEqual(self.good(client.read_holding_registers(0, count=100, **UNIT)).registers, values)
        self.good(client.write_registers(0, list(range(100)), **UNIT))
        self.good(client.write_register(100, 200, **UNIT))
        self.refused(client.write_register(100, 201, **UNIT), ILLEGAL_VALUE)
        self.refused(client.write_registers(108, [100, 100, 4], **UNIT), ILLEGAL_VALUE)
        self.assertEqual(self.good(client.read_holding_registers(100, count=9, **UNIT)).registers,
                         [200, *range(101, 109)])
        self.good(client.write_register(100, 100, **UNIT))
        self.refused(client.write_registers(119, [0, 0], **UNIT), NACK)
        self.good(client.write_coil(120, False, **UNIT))
        self.good(client.write_register(120, 120, **UNIT))
        self.good(client.write_coil(120, True, **UNIT))

    def test_04_input_registers(self):
        inputs = self.good(self.client.read_input_registers(3, count=125, **UNIT))
        self.assertEqual(inputs.registers, list(range(0x1003, 0x1080)))

    def test_07_exception_status(self):
        self.good(self.client.write_coils(0, [True, False, False, True], **UNIT))
        self.assertEqual(self.good(self.client.read_exception_status(**UNIT)).status, 0b1001)
        self.good(self.client.write_coils(0, [False] * 4, **UNIT))

    def test_08_query_data(self):
        for message in self.messages:
            with self.subTest(message):
                answer = self.good(self.client.diag_query_data(message, **UNIT))
                self.assertEqual(answer.message, message)

    def test_08_0b_counters(self):
        client = self.client
        self.good(client.diag_clear_counters(**UNIT))
        self.assertEqual(
            self.counters(),
            {"messages": 1, "errors": 0, "exceptions": 0, "addressed": 4}
            | {"unanswered": 0, "nak": 0, "busy": 0, "overruns": 0},
        )
        self.assertEqual(self.good(client.diag_get_comm_event_counter(**UNIT)).count, 8)
        self.good(client.diag_restart_communication(False, **UNIT))
        self.refused(client.read_coils(128, **UNIT), ILLEGAL_ADDRESS)
        self.refused(client.write_register(125, 0, **UNIT), NACK)
        self.unheard(client.write_coil, 50, False, device_id=0)
        self.unheard(client.write_coil, 50, False, device_id=9)
        self.assertEqual(
            self.counters(),
            {"messages": 5, "errors": 0, "exceptions": 2, "addressed": 7}
            | {"unanswered": 1, "nak": 1, "busy": 0, "overruns": 0},
        )
        self.assertEqual(self.good(client.diag_read_diagnostic_register(**UNIT)).message, 0)
        self.good(client.diag_clear_overrun_counter(**UNIT))
        counter = self.good(client.diag_get_comm_event_counter(**UNIT))
        self.assertTrue(counter.status)
        # The broadcast, eight counters, the register, the clearing.
        self.assertEqual(counter.count, 11)

    def test_08_listen_only(self):
        client = self.client
        self.good(client.diag_restart_communication(True, **UNIT))
        self.unheard(client.diag_force_listen_only, **UNIT)
        client.comm_params.timeout_connect = 0.2
        for send in (client.read_exception_status, client.diag_read_bus_message_count):
            with self.assertRaises(ModbusIOException):
                send(**UNIT)
        with self.assertRaises(ModbusIOException):
            client.diag_restart_communication(False, **UNIT)
        client.comm_params.timeout_connect = 10
        log = self.good(client.diag_get_comm_event_log(**UNIT))
        self.assertEqual(log.message_count, 1)
        listened = [0x60, 0xA0] * 3
        self.assertEqual(log.events, [0x80, 0x00, *listened, 0x60, 0x04, 0x80, 0x00])

    def test_0c_event_log(self):
        client = self.client
        self.good(client.diag_restart_communication(True, **UNIT))
        self.refused(client.read_coils(128, **UNIT), ILLEGAL_ADDRESS)
        self.unheard(client.write_coil, 50, False, device_id=0)
        log = self.good(client.diag_get_comm_event_log(**UNIT))
        self.assertEqual(log.events, [0x80, 0x40, 0xC0, 0x41, 0x80, 0x00])
        self.assertEqual((log.status, log.event_count, log.message_count), (True, 1, 3))
        for _ in range(40):
            self.good(client.read_exception_status(**UNIT))
        log = self.good(client.diag_get_comm_event_log(**UNIT))
        self.assertEqual(log.events, [0x80] + [0x40, 0x80] * 31 + [0x40])

    def test_11_server_id(self):
        answer = self.good(self.client.report_device_id(**UNIT))
        # pymodbus takes the last byte for the run indicator, which is behind the id (APP 6.13).
        self.assertEqual(answer.identifier, b"\x11\xffmultidro")

    def files(self):
        """32 records of file 4, each its number at boot."""
        record = {"file_number": 4, "record_number": 30}
        # pymodbus counts bytes.
        read = [
            FileRecord(**record, record_length=4),
            FileRecord(file_number=4, record_number=1, record_length=2),
        ]
        answer = self.good(self.client.read_file_record(read, **UNIT))
        self.assertEqual([one.record_data for one in answer.records], [b"\x00\x1e\x00\x1f", b"\x00\x01"])
        for data in (b"\xa5\x5a\x12\x34", b"\x00\x1e\x00\x1f"):
            write = [FileRecord(**record, record_data=data)]
            self.good(self.client.write_file_record(write, **UNIT))
            answer = self.good(self.client.read_file_record(read, **UNIT))
            self.assertEqual(answer.records[0].record_data, data)
        past = [FileRecord(file_number=4, record_number=31, record_length=4)]
        self.refused(self.client.read_file_record(past, **UNIT), ILLEGAL_ADDRESS)

    def test_14_15_files(self):
        if self.board == "stm32":
            return self.files()
        records = [FileRecord(file_number=4, record_number=1, record_length=2)]
        self.refused(self.client.read_file_record(records, **UNIT), ILLEGAL_FUNCTION)
        records = [FileRecord(file_number=4, record_number=1, record_data=b"\x00\x01")]
        self.refused(self.client.write_file_record(records, **UNIT), ILLEGAL_FUNCTION)

    def test_16_mask_write(self):
        client = self.client
        masks = {"and_mask": 0x00F2, "or_mask": 0x0025}
        self.good(client.write_register(4, 0x0012, **UNIT))
        self.good(client.mask_write_register(address=4, **masks, **UNIT))
        self.assertEqual(self.good(client.read_holding_registers(4, **UNIT)).registers, [0x0017])
        self.good(client.write_register(4, 4, **UNIT))
        self.refused(client.mask_write_register(address=110, **masks, **UNIT), ILLEGAL_VALUE)

    def test_17_write_then_read(self):
        answer = self.client.readwrite_registers(
            read_address=10, read_count=118, write_address=12, values=[7, 8], **UNIT
        )
        expected = [10, 11, 7, 8, *range(14, 128)]
        self.assertEqual(self.good(answer).registers, expected)
        self.good(self.client.write_registers(12, [12, 13], **UNIT))

    def test_18_fifo_queue(self):
        answer = self.good(self.client.read_fifo_queue(address=0x04DE, **UNIT))
        self.assertEqual(answer.values, [0x01B8, 0x1284])
        self.refused(self.client.read_fifo_queue(address=0x04DF, **UNIT), ILLEGAL_ADDRESS)

    def test_2b_identification(self):
        client = self.client
        basic = self.good(client.read_device_information(read_code=1, **UNIT))
        self.assertEqual(basic.information[0], b"multidrop")
        self.assertEqual(basic.information[1], self.board.encode())
        self.assertEqual(sorted(basic.information), [0, 1, 2])
        self.assertEqual((basic.conformity, basic.more_follows), (0x82, 0))
        regular = self.good(client.read_device_information(read_code=2, object_id=2, **UNIT))
        self.assertEqual(sorted(regular.information), [2, 6])
        one = self.good(client.read_device_information(read_code=4, object_id=6, **UNIT))
        self.assertEqual(one.information, {6: b"conformance"})
        self.refused(client.read_device_information(read_code=4, object_id=5, **UNIT), ILLEGAL_ADDRESS)


class Rtu(Functions, unittest.TestCase):
    """RTU, 38400 8N1."""

    settings = {"baudrate": 38400}

    def setUp(self):
        super().setUp()
        # pymodbus takes the answer for two bytes shorter than it is (APP 6.18), and the CRC for wrong.
        size = classmethod(lambda cls, data: int.from_bytes(data[2:4], "big") + 6)
        mended = mock.patch.object(ReadFifoQueueResponse, "calculateRtuFrameSize", size)
        mended.start()
        self.addCleanup(mended.stop)

    def test_08_delimiter_is_kept_for_ascii(self):
        self.good(self.client.diag_change_ascii_input_delimeter(delimiter=0x2100, **UNIT))
        self.good(self.client.read_exception_status(**UNIT))


class Ascii(Functions, unittest.TestCase):
    """ASCII, 19200 7E1, as the standard has it by default."""

    options = ("--ascii", "--baud", "19200")
    # A pseudo terminal takes no format but 8N1; on the bus it is 7E1.
    settings = {"baudrate": 19200, "framer": FramerType.ASCII}

    messages = (*Functions.messages, b"", b"\xa5", bytes(range(250)))

    def test_08_delimiter(self):
        block = ModbusControlBlock()
        self.addCleanup(setattr, block, "Delimiter", block.Delimiter)
        for delimiter in b"!\n":
            # In the high byte (APP 6.8.1), where pymodbus does not put it by itself.
            change = self.client.diag_change_ascii_input_delimeter
            self.good(change(delimiter=delimiter << 8, **UNIT))
            block.Delimiter = bytes([delimiter])
            self.good(self.client.read_exception_status(**UNIT))

    def test_lower_case_is_accepted(self):
        self.client.close()
        self.client = ModbusSerialClient(
            self.bus.port,
            timeout=10,
            retries=0,
            trace_packet=lambda sending, packet: packet.lower() if sending else packet,
            **self.settings,
        )
        self.assertTrue(self.client.connect())
        self.addCleanup(self.client.close)
        inputs = self.good(self.client.read_input_registers(0x0A, count=2, **UNIT))
        self.assertEqual(inputs.registers, [0x100A, 0x100B])


class Stm32Rtu(Rtu):
    """The STM32's RS4 in QEMU, RTU."""

    board = "stm32"


class Stm32Ascii(Ascii):
    """The STM32's RS4 in QEMU, ASCII."""

    board = "stm32"


if __name__ == "__main__":
    unittest.main()
