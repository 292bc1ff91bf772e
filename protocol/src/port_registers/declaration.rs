//! What each register of a port is: the one place that says so.

/// Gives the declaration of all registers to the macro `$each`, which takes from it what it needs: the enum with numbers and names, the
/// values and their ranges, the settings, loading and reading, the builder of `multidrop::PortConfig`, the guide's table.
///
/// A row is
///
/// ```text
/// /// What it does. The first paragraph is the cell of the guide's table.
/// NUMBER NAME Variant [index: Index]: Type in LOW..=HIGH of "CHOICES" => field = DEFAULT;
/// ```
///
/// | part | meaning |
/// |---|---|
/// | `NUMBER` | the number on the wire: it never changes, and a new register takes the next free one |
/// | `NAME` | the name without `MB_<port>_` |
/// | `Variant` | its place in [`Register`](crate::port_registers::Register) |
/// | `[index: Index]` | for an array: the type of its index |
/// | `: Type` | the type of its value in [`Value`](crate::port_registers::Value) |
/// | `in LOW..=HIGH` | the accepted numbers, which are in the message for a wrong one |
/// | `of "CHOICES"` | the accepted numbers in words, for the message, if they are few; without `in` and `of` the register is read only |
/// | `=> field = DEFAULT` | of `port` its field in `PortSettings`, of `line` in `LineSettings`, with the default |
#[doc(hidden)]
#[macro_export]
macro_rules! port_registers {
    ($each:ident) => {
        $each! {
            typed {
                // Settings of the port.
                port {
                    /// 0 master, 1 slave, 2 off, 3 sniffer. 4, sensor node, is refused: it is not in this version.
                    0 MODE Mode: Mode of "0 (master), 1 (slave), 2 (off) or 3 (sniffer)" => mode = Mode::Slave;

                    /// Address of the first item of dense REGS and COILS; the last item must not be above 65535.
                    ///
                    /// Set it before the banks are made of the configuration.
                    2 BASE Base: u16 in 0..=65_535 => base = 0;

                    /// A slave's own unit id; for a master the unit id of its requests, 0..=247, where 0 is a broadcast.
                    ///
                    /// A slave has 1..=247 (SER 2.2).
                    5 SLAVEID SlaveId: u8 in 0..=247 => slave_id = 1;

                    /// How long a master waits from the end of its request to the beginning of the answer, in ms.
                    13 TIMEOUT Timeout: u16 in 1..=65_535 => timeout_ms = 1000;

                    /// How often a master sends a request again.
                    14 RETRIES Retries: u8 in 0..=255 => retries = 0;

                    /// How long a master sends nothing after a broadcast, in ms.
                    ///
                    /// See SER 2.4.1.
                    15 TURNAROUND Turnaround: u16 in 0..=65_535 => turnaround_ms = 100;

                    /// How long after a timeout a late answer is expected, in ms; 0 means TIMEOUT.
                    28 LATE_GUARD LateGuard: u16 in 0..=65_535 => late_guard_ms = 0;

                    /// How long a master sends nothing after an answer, in ms.
                    ///
                    /// For units that need a pause.
                    30 REQUEST_GAP RequestGap: u16 in 0..=65_535 => request_gap_ms = 0;
                }
                // Settings of its line: the board is asked whether it can do them.
                line {
                    /// 0 RTU, 1 ASCII, 2 text: a sniffer or a port that is off, which prints.
                    ///
                    /// Set it before the format: seven data bits are not for RTU.
                    1 FRAMING Framing: Framing of "0 (RTU), 1 (ASCII) or 2 (text)" => framing = Framing::Rtu;

                    /// Bits per second, if the clock makes them within 2.5 %.
                    22 BAUD Baud: u32 in 300..=10_000_000 => baud = 19_200;

                    /// 0 8N1, 1 8E1, 2 8O1, 3 8N2; with ASCII also 4 7E1, 5 7O1, 6 7N2.
                    ///
                    /// RTU needs eight data bits (SER 2.5.1), ASCII has 7E1 as default (SER 2.5.2).
                    23 FORMAT Format: LineFormat of "8N1 (0), 8E1 (1), 8O1 (2), 8N2 (3), 7E1 (4), 7O1 (5) or 7N2 (6)"
                        => format = LineFormat::F8E1;

                    /// 0 half, 1 full. DUPLEX accepts only the mode that the port is wired for.
                    24 DUPLEX Duplex: Duplex of "0 (half) or 1 (full)" => duplex = Duplex::Half;

                    /// 0 none, 1 RTS/CTS, on ports that were opened with these pins.
                    25 FLOW Flow: Flow of "0 (none) or 1 (RTS/CTS)" => flow = Flow::None;

                    /// 0: a gap of more than t1.5 voids a frame; 1: gaps shorter than t3.5 do no harm; 2 to 50: a silence of this number of
                    /// ms ends a frame.
                    26 INTER_CHARACTER InterCharacter: InterCharacter
                        in 0..=50 of "0 (strict), 1 (off) or 2..=50 (ms that end a frame)"
                        => inter_character = InterCharacter::Strict;

                    /// How long a frame waits for CTS before it is dropped, in ms.
                    ///
                    /// Without RTS/CTS it has no effect.
                    29 CTS_TIMEOUT CtsTimeout: u16 in 1..=65_535 => cts_timeout_ms = 1000;

                    /// How long DE is up before the first start bit, in us.
                    ///
                    /// For transceivers and repeaters that need time to turn on. DE goes up at t3.5.
                    31 DE_LEAD DeLead: u16 in 0..=10_000 => de_lead_us = 0;

                    /// How long a slave's answer is delayed after t3.5, in ms.
                    ///
                    /// For masters that let go of the bus late.
                    32 RESPONSE_DELAY ResponseDelay: u16 in 0..=1000 => response_delay_ms = 0;
                }
                // What a master's transaction is; `PortRegisters` loads and reads these and all below.
                transaction {
                    /// The function of a master's transaction, in decimal; without coils only 3, 4, 6, 16, 23.
                    6 FUNC Func: u8 of "1, 2, 3, 4, 5, 6, 15, 16 or 23; other functions are methods of the client";

                    /// The first element of REGS in a transaction.
                    7 REGOFF RegOff: u16 in 0..=65_535;

                    /// The number of registers. To write 1..=123, with FUNC 6 only 1, with FUNC 23 1..=121; a scan list takes
                    /// 1..=65535.
                    8 REGCNT RegCnt: u16 in 1..=125;

                    /// The first coil of a transaction.
                    9 COILOFF CoilOff: u16 in 0..=65_535;

                    /// The number of coils. To write 1..=1968, with FUNC 5 only 1.
                    10 COILCNT CoilCnt: u16 in 1..=2000;
                }
                arrays {
                    /// The registers of the port.
                    3 REGS Regs [index: u16]: u16 in 0..=65_535;

                    /// The coils; 1 and 255 are on.
                    4 COILS Coils [index: u16]: bool of "0 (off) or 1 (on)";

                    /// 0 enables writes to DISABLE_REG.n, 1 refuses them with exception 07.
                    21 DISABLE_FLG DisableFlg [index: u8]: bool of "0 (enabled) or 1 (disabled)";
                }
            }
            // Without a type: read only, or a command.
            untyped {
                results {
                    /// The state of the transaction, or its result: see STATUS.
                    11 STATUS Status;

                    /// The exception code of the last transaction, 0 for none.
                    12 ERROR Error;

                    /// Successful transactions, modulo 65536.
                    16 DATAOK DataOk;

                    /// Failed transactions, modulo 65536.
                    17 DATAERR DataErr;

                    /// The registers of a rule on values: the first one times 65536 plus the last one.
                    18 VALID_DATA ValidData [index: u8];

                    /// A range of registers that exist, written as in VALID_DATA.
                    19 VALID_REG ValidReg [index: u8];

                    /// A range of registers that can be disabled, written as in VALID_DATA.
                    20 DISABLE_REG DisableReg [index: u8];
                }
                command {
                    /// 1 starts a transaction; it reads 1 while the transaction runs. iDevOS writes it `LOAD(RS4, 1)`.
                    27 START Start of "1";
                }
            }
        }
    };
}
