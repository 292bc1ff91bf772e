//! The lines of the STM32 in QEMU: when they answer, what they take for a frame, and four of them at once.

mod common;

use common::frames::{block, words};
use common::plain::wire::from_rtu;
use common::{LINE, Rig, stm32_example, stm32_registers};
use multidrop_bus::{
    Bus, BusConfig, HostId, HostPort, Line, MachineId, Stm32, Time, Tx, WireId, barrier,
};

/// A read of one register of unit 1.
fn request() -> Vec<u8> {
    words(1, 3, 0, 1)
}

#[test]
fn answers_begin_at_t3_5() {
    let mut rig = Rig::stm32(&stm32_registers(), LINE);
    for step in 0..20 {
        rig.pause(Time::from_ns(5_000_000 + step * 1_237));
        for request in [
            words(1, 3, 0, 1),
            words(1, 3, 0, 16),
            words(1, 6, 0, 7),
            block(1, 16, 0, 16, &[1; 32]),
        ] {
            let answer = rig.exchange(&request).expect("an answer");
            let beyond = answer.turnaround().saturating_sub(LINE.t35());
            // That it is not before t3.5 is a rule of the bus, which every exchange is held against.
            assert!(beyond < LINE.bits(1), "{beyond} after {request:02x?}");
        }
    }
}

#[test]
fn a_frame_is_what_has_no_gap_over_t1_5() {
    let mut rig = Rig::stm32(&stm32_registers(), LINE);
    for (gap_us, answered) in [
        (700, true),
        (740, true),
        (750, true),
        (758, false),
        (1000, false),
        (1700, false),
    ] {
        let characters = request().into_iter().enumerate().map(|(index, byte)| {
            let gap = if index == 4 { gap_us } else { 0 };
            Tx::byte(byte).after(Time::from_us(gap))
        });
        let characters: Vec<_> = characters.collect();
        assert_eq!(
            !rig.ask_each(characters).is_empty(),
            answered,
            "{gap_us} us"
        );
        rig.pause(Time::from_ms(5));
    }
}

#[test]
fn a_request_at_t3_5_after_another_units_is_heard() {
    let mut rig = Rig::stm32(&stm32_registers(), LINE);
    for (pause_us, answered) in [(1700, false), (1750, true), (1760, true)] {
        let other = words(9, 3, 0, 1).into_iter().map(Tx::byte);
        let ours = request().into_iter().enumerate().map(|(index, byte)| {
            let pause = if index == 0 { pause_us } else { 0 };
            Tx::byte(byte).after(Time::from_us(pause))
        });
        let characters: Vec<_> = other.chain(ours).collect();
        assert_eq!(
            !rig.ask_each(characters).is_empty(),
            answered,
            "{pause_us} us"
        );
        rig.pause(Time::from_ms(5));
    }
}

/// The machine with a server on each port, each on a wire of its own with a host.
struct Four {
    bus: Bus,
    hosts: [HostId; 4],
    machine: MachineId,
}

impl Four {
    fn at(baud: u32) -> Self {
        let mut bus = Bus::new(BusConfig::default());
        let wires = [
            WireId::default(),
            bus.add_wire(),
            bus.add_wire(),
            bus.add_wire(),
        ];
        let port = || HostPort::new(Line::n81(baud));
        let hosts = wires.map(|wire| bus.add_host_on(wire, port()));
        let stm32 = Stm32 {
            name: "stm32".to_owned(),
            image: stm32_example("servers", baud),
            plugin: barrier().expect("set-up has built it"),
            wires: wires.map(Some),
        };
        let machine = bus.add_stm32(stm32).expect("QEMU runs");
        bus.run_for(Time::from_ms(10));
        Four {
            bus,
            hosts,
            machine,
        }
    }

    /// A request on each wire, so much after each other; the answers.
    fn round(&mut self, requests: [&[u8]; 4], stagger: Time) -> [Vec<u8>; 4] {
        for (host, request) in self.hosts.into_iter().zip(requests) {
            self.bus.host(host).take();
            self.bus.host(host).send(request);
            self.bus.run_for(stagger);
        }
        self.bus.run_for(Time::from_ms(80));
        self.hosts.map(|host| {
            let heard = self.bus.host(host).take();
            heard.iter().map(|byte| byte.value).collect()
        })
    }

    fn overruns(&self) -> [u64; 4] {
        [0, 1, 2, 3].map(|port| self.bus.machine(self.machine).overruns(port))
    }
}

#[test]
fn four_ports_at_once_lose_nothing() {
    for (baud, rounds) in [(115_200, 10), (2_000_000, 30)] {
        let mut four = Four::at(baud);
        for round in 0..rounds {
            let values: Vec<u8> = (0..246u16).map(|i| (i * 7 + round) as u8).collect();
            let write = block(1, 16, 0, 123, &values);
            let read = words(1, 3, 0, 125);
            let stagger = Time::from_ns(u64::from(round) * 137);
            let answers = four.round([&write, &read, &read, &write], stagger);
            assert_eq!(
                answers.each_ref().map(Vec::len),
                [8, 255, 255, 8],
                "round {round} at {baud}"
            );
            assert!(answers.iter().all(|answer| from_rtu(answer).is_some()));
        }
        assert_eq!(four.overruns(), [0; 4], "{baud}");
    }
}

#[test]
fn garbage_on_one_port_delays_another_by_its_interrupts_only() {
    const BAUD: u32 = 115_200;
    let slowest = |garbage: bool| {
        let mut four = Four::at(BAUD);
        let [as1, _, rs2, _] = four.hosts;
        let times = (0..20u64).map(|round| {
            if garbage {
                let noise = (0..400).map(|index| {
                    let byte = Tx::byte((index * 37 + round) as u8);
                    if index % 7 == 3 {
                        byte.bad_stop()
                    } else {
                        byte
                    }
                });
                four.bus.host(rs2).send_each(noise.collect::<Vec<_>>());
            }
            four.bus.run_for(Time::from_ns(1000 + round * 1237));
            let request = words(1, 3, 0, 16);
            let answer = four.bus.transact(as1, &request, Time::from_ms(20));
            four.bus.run_for(Time::from_ms(60));
            answer.expect("an answer").turnaround()
        });
        times.max().unwrap_or_default()
    };
    // At 115200 baud no more than one character of the garbage falls into the time between t3.5 and the answer; its
    // interrupt is about a hundred instructions, 0.8 us.
    let delay = slowest(true).saturating_sub(slowest(false));
    assert!(delay < Time::from_us(2), "{delay}");
}
