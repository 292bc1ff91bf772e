"""The client of the firmware, on the simulated bus, against pymodbus's server: every function that both know."""

import asyncio
import logging
import unittest

from pymodbus import FramerType, ModbusDeviceIdentification
from pymodbus.datastore import (
    ModbusDeviceContext,
    ModbusSequentialDataBlock,
    ModbusServerContext,
)
from pymodbus.pdu import ModbusPDU
from pymodbus.server import ModbusSerialServer

from bus import Bus

UNIT = 17
# The image board-nano/src/bin/client-functions.rs asks one function after the other, keeps a word for what
# became of each, and writes the words to these registers at the end.
REPORT, STEPS = 40, 41
# As it says: the answer expected, another one, an exception, nothing, not sent, wrong content.
GOOD, OTHER = 1, 2
ILLEGAL_ADDRESS, NOTHING, NOT_SENT, WRONG_CONTENT = 0x8002, 0x4006, 0x4007, 0x4009
# All steps take some 3 s on an idle machine.
PATIENCE_S = 120


class Reverse(ModbusPDU):
    """FC 41, which pymodbus has to be told of: three bytes, answered in reverse order."""

    function_code = 0x41
    rtu_frame_size = 7

    def encode(self):
        return self.data

    def decode(self, data):
        self.data = data

    async def datastore_update(self, _context, device_id):
        answer = Reverse(dev_id=device_id, transaction_id=self.transaction_id)
        answer.data = self.data[::-1]
        return answer


def tables():
    """As in the image conformance, as far as pymodbus's blocks go, whose first address is 1."""

    def block(values):
        return ModbusSequentialDataBlock(1, values)

    addresses = range(128)
    return ModbusDeviceContext(
        di=block([address % 3 == 0 for address in addresses]),
        co=block([False for _ in addresses]),
        hr=block(list(addresses)),
        ir=block([0x1000 + address for address in addresses]),
    )


class Steps:
    """What becomes of each step is the same in both framings, but for what pymodbus makes of RTU."""

    options, framer, baudrate = (), None, 38400
    query_data = GOOD

    def expected(self):
        words = dict.fromkeys(range(REPORT, REPORT + STEPS), GOOD)
        # The eight bits are pymodbus's own.
        words[51] = OTHER
        words[52] = self.query_data
        # The run indicator is at the end, where no id of one byte has it.
        words[70] = OTHER
        # Its records are a text, which is not as long as was asked for.
        words[72] = WRONG_CONTENT
        # Another queue.
        words[73] = OTHER
        words[79] = ILLEGAL_ADDRESS
        words[80] = NOT_SENT
        return words

    def setUp(self):
        # It tells of every frame around each one that it does not understand.
        logging.disable(logging.CRITICAL)
        self.addCleanup(logging.disable, logging.NOTSET)

    async def test_every_function(self):
        bus = Bus("client-functions", *self.options)
        self.addCleanup(bus.stop)
        asked, words = [], asyncio.get_running_loop().create_future()

        def trace(sending, pdu):
            if not sending:
                asked.append(pdu.function_code)
                if pdu.function_code == 0x10 and pdu.address == REPORT and not words.done():
                    words.set_result(dict(enumerate(pdu.registers, REPORT)))
            return pdu

        names = {"VendorName": "multidrop", "ProductCode": "nano", "MajorMinorRevision": "0"}
        server = ModbusSerialServer(
            ModbusServerContext(devices={UNIT: tables()}),
            framer=self.framer,
            port=bus.port,
            baudrate=self.baudrate,
            identity=ModbusDeviceIdentification(info_name=names),
            broadcast_enable=True,
            trace_pdu=trace,
            custom_pdu=[Reverse],
        )
        serving = asyncio.create_task(server.serve_forever())
        try:
            told = await asyncio.wait_for(words, PATIENCE_S)
        finally:
            await server.shutdown()
            await serving
        self.assertEqual(told, self.expected())
        known = {*range(1, 9), 0x0B, 0x0C, *range(0x0F, 0x12), *range(0x14, 0x19), 0x2B, 0x41}
        self.assertEqual(set(asked), known)


class Rtu(Steps, unittest.IsolatedAsyncioTestCase):
    """RTU, 38400 8N1."""

    framer = FramerType.RTU
    # pymodbus takes every request of FC 08 for 8 bytes long.
    query_data = NOTHING


class Ascii(Steps, unittest.IsolatedAsyncioTestCase):
    """ASCII, 38400 7E1 on the bus."""

    options = ("--ascii",)
    framer = FramerType.ASCII


if __name__ == "__main__":
    unittest.main()
