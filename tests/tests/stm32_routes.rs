//! The router of `ports`, from AS1 and AS2 to units on RS4 that are slow, late or missing, for clients that do not
//! wait. The scan list asks on RS4 beside it all the time. The units are a host that answers by a script.

use std::cell::{Cell, RefCell};

use multidrop_bus::{Frame, Framing, HostId, Line, Time, framed, frames};
use multidrop_testkit::four::units::{Played, Reply, Told, asked, asked_or_cut};
use multidrop_testkit::four::{AS1, AS2, ASCII, BusClient, LINE, RS4, Report, Source, setting};
use multidrop_testkit::plain::wire::Way;
use multidrop_testkit::{Runner, on_both, ports};

on_both! {
    a_slow_unit_is_waited_for,
    a_missing_unit_is_told_in_time_and_keeps_nobody,
    an_answer_that_comes_in_the_wait_for_another_is_dropped_if_it_can_be_told_from_it,
    an_answer_behind_its_time_is_dropped_while_nobody_waits_or_a_poll_does,
    a_late_answer_never_becomes_the_value_of_another_register,
    a_long_answer_is_heard_to_its_end,
    what_is_too_long_for_an_answer_is_not_heard_to_its_end,
    one_silent_unit_among_four_holds_nobody_else_up,
    two_clients_and_the_scan_list_share_the_bus_and_nobody_waits_for_more_than_two_others,
    a_client_that_is_gone_keeps_nobody_and_its_answer_is_sent_to_nobody_else,
    units_are_renumbered_there_and_back_and_a_ports_own_unit_goes_first,
    while_rs4_is_no_master_the_clients_are_told_so_at_once,
}

/// What a unit that is up to date takes.
const FAST: Time = Time::from_ms(3);

/// Where what is routed is asked for; the scan list asks for register 0.
const ROUTED: u16 = 100;

/// AS1's unit, and AS2's.
const OWN: [u8; 2] = [10, 1];

fn played<'a>(runner: Runner, script: impl FnMut(&[u8]) -> Vec<Reply> + 'a) -> Played<'a> {
    Played::new(&ports(runner), runner.emulator(), script).expect("a valid image")
}

fn body(unit: u8, function: u8, first: u16, second: u16) -> Vec<u8> {
    let words = [first.to_be_bytes(), second.to_be_bytes()];
    [&[unit, function], words.as_flattened()].concat()
}

/// FC 03 of `count` registers from `first`.
fn read(unit: u8, first: u16, count: u16) -> Vec<u8> {
    body(unit, 3, first, count)
}

/// What a unit answers: a write of a register as it came, a read with bytes made of its id, the address and `mark`.
fn values(request: &[u8], mark: u8) -> Vec<u8> {
    if request[1] == 6 {
        return request.to_vec();
    }
    let [unit, function, _, first, _, count] = *request else {
        panic!("{request:02x?} is no read");
    };
    let mut answer = vec![unit, function, 2 * count];
    answer.extend((0..2 * count).map(|place| unit.wrapping_mul(31) ^ first ^ place ^ mark));
    answer
}

fn first(request: &[u8]) -> u16 {
    u16::from_be_bytes([request[2], request[3]])
}

/// The exception that a request is answered with.
fn exception(request: &[u8], code: u8) -> Vec<u8> {
    vec![request[0], request[1] | 0x80, code]
}

/// A reply at once.
fn at_once(body: Vec<u8>) -> Vec<Reply> {
    vec![(FAST, body)]
}

#[track_caller]
fn expect(played: &mut Played, way: Way, request: &[u8], answer: &[u8]) -> Told {
    let told = played.ask(way, request);
    assert_eq!(told.body, answer, "{request:02x?}");
    told
}

/// Of each unit: good answers to polls, and other ends of them.
fn health(played: &mut Played) -> ([u16; 3], [u16; 3]) {
    let told = played.ask(Way::Rtu, &body(10, 4, 3, 6)).body;
    assert_eq!(told[..3], [10, 4, 12]);
    let word = |place: usize| u16::from_be_bytes([told[3 + 2 * place], told[4 + 2 * place]]);
    ([0, 1, 2].map(word), [3, 4, 5].map(word))
}

fn a_slow_unit_is_waited_for(runner: Runner) {
    // Its answer is over 46 ms after the request, and 50 ms is the route's time.
    let slow = Time::from_ms(44);
    let mut played = played(runner, |request| {
        let delay = if request[0] == 1 { slow } else { FAST };
        vec![(delay, values(request, 0))]
    });
    for round in 0..10 {
        let request = read(1, ROUTED + round, 2);
        let told = expect(&mut played, Way::Rtu, &request, &values(&request, 0));
        // Behind a poll of this unit and one of another at most.
        assert!(told.turnaround > slow && told.turnaround < slow * 2 + Time::from_ms(20));
        let request = read(11, ROUTED + round, 2);
        let mut answer = values(&read(1, ROUTED + round, 2), 0);
        answer[0] = 11;
        expect(&mut played, Way::Ascii, &request, &answer);
        let request = read(2, ROUTED, 1);
        expect(&mut played, Way::Rtu, &request, &values(&request, 0));
    }
    let (good, bad) = health(&mut played);
    assert!(good.iter().all(|count| *count > 8), "{good:?}");
    assert_eq!(bad, [0; 3]);
    let asked = asked(&played.desk);
    let (_, before) = asked.split_last().expect("requests");
    assert!(before.iter().all(|asked| asked.answered.is_some()));
}

fn a_missing_unit_is_told_in_time_and_keeps_nobody(runner: Runner) {
    let mut played = played(runner, |request| match request[0] {
        1 => Vec::new(),
        _ => at_once(values(request, 0)),
    });
    for round in 0..10 {
        let request = read(1, ROUTED, 1);
        let told = expect(&mut played, Way::Rtu, &request, &exception(&request, 0x0B));
        // Behind a poll of this unit, the guard behind that, and polls of the other two.
        assert!(told.turnaround < Time::from_ms(175), "{}", told.turnaround);
        let request = read(11, ROUTED, 1);
        let answer = exception(&request, 0x0B);
        expect(&mut played, Way::Ascii, &request, &answer);
        let request = read(3, ROUTED + round, 4);
        expect(&mut played, Way::Rtu, &request, &values(&request, 0));
    }
    let (good, bad) = health(&mut played);
    assert_eq!((good[0], bad[1], bad[2]), (0, 0, 0));
    for asked in asked(&played.desk) {
        assert_eq!(asked.answered.is_some(), asked.body[0] != 1);
    }
}

/// Unit 1 does not answer the first request, but answers it in the middle of the wait for the second one, and that one
/// behind it. Returns what the PC is told of both.
fn late(runner: Runner, first_asked: &[u8], second_asked: &[u8]) -> [Vec<u8>; 2] {
    let missing = RefCell::new(Vec::new());
    let mut played = played(runner, |request| {
        let right = values(request, if first(request) < ROUTED { 0 } else { 2 });
        if first(request) < ROUTED {
            return at_once(right);
        }
        let mut missing = missing.borrow_mut();
        if missing.is_empty() {
            missing.extend(values(request, 1));
            return Vec::new();
        }
        vec![(FAST, missing.clone()), (FAST * 4, right)]
    });
    // Polls are answered before, between and behind.
    played.run_for(Time::from_ms(150), |_| ());
    let told = [first_asked, second_asked].map(|request| {
        let told = played.ask(Way::Rtu, request);
        played.run_for(Time::from_ms(150), |_| ());
        told.body
    });
    let (good, bad) = health(&mut played);
    assert!(good.iter().all(|count| *count > 4), "{good:?}");
    assert_eq!(bad, [0; 3]);
    // What is kept of the polls is nothing else.
    let polled = played.ask(Way::Rtu, &body(10, 4, 0, 3)).body;
    let expected = [1, 2, 3].map(|unit| values(&read(unit, 0, 1), 0)[3..].to_vec());
    assert_eq!(polled[3..], expected.concat());
    asked(&played.desk);
    told
}

fn an_answer_that_comes_in_the_wait_for_another_is_dropped_if_it_can_be_told_from_it(
    runner: Runner,
) {
    let first = read(1, ROUTED, 2);
    let write = |value| body(1, 6, ROUTED, value);
    for (first, second) in [
        // Another unit, another function, another length, another value.
        (first.clone(), read(2, ROUTED, 2)),
        (first.clone(), body(1, 4, ROUTED, 2)),
        (first.clone(), read(1, ROUTED, 3)),
        (write(7), write(8)),
    ] {
        let told = late(runner, &first, &second);
        assert_eq!(told[0], exception(&first, 0x0B));
        assert_eq!(told[1], values(&second, 2), "{second:02x?}");
    }
    // Nothing in a Modbus frame says which of two such requests it answers, and the guard is over.
    let told = late(runner, &first, &read(1, ROUTED + 1, 2));
    assert_eq!(told, [exception(&first, 0x0B), values(&first, 1)]);
}

fn an_answer_behind_its_time_is_dropped_while_nobody_waits_or_a_poll_does(runner: Runner) {
    let delay = Cell::new(Time::ZERO);
    let mut played = played(runner, |request| match first(request) {
        ROUTED => vec![(delay.get(), values(request, 1))],
        _ => at_once(values(request, 0)),
    });
    for ms in [53, 58, 63, 71, 80] {
        delay.set(Time::from_ms(ms));
        let request = read(1, ROUTED, 2);
        expect(&mut played, Way::Rtu, &request, &exception(&request, 0x0B));
        let request = read(1, ROUTED + 1, 3);
        expect(&mut played, Way::Rtu, &request, &values(&request, 0));
        played.run_for(Time::from_ms(137), |_| ());
        let request = read(2, ROUTED + 1, 2);
        expect(&mut played, Way::Rtu, &request, &values(&request, 0));
    }
    let (_, bad) = health(&mut played);
    assert_eq!(bad, [0; 3]);
    asked(&played.desk);
}

/// Unit 1 answers what is routed to it behind RS4's time, in the same shape as the polls of its register 0.
fn a_late_answer_never_becomes_the_value_of_another_register(runner: Runner) {
    let delay = Cell::new(Time::ZERO);
    let mut played = played(runner, |request| match first(request) {
        0 => at_once(values(request, 0)),
        _ => vec![(delay.get(), values(request, 1))],
    });
    let polled = values(&read(1, 0, 1), 0)[3..].to_vec();
    for ms in [52, 57, 63, 70, 78, 88, 95] {
        delay.set(Time::from_ms(ms));
        let request = read(1, ROUTED, 1);
        expect(&mut played, Way::Rtu, &request, &exception(&request, 0x0B));
        for _ in 0..12 {
            played.run_for(Time::from_ms(10), |_| ());
            let told = played.ask(Way::Rtu, &body(10, 4, 0, 1)).body;
            assert_eq!(told[3..], polled, "answered after {ms} ms");
        }
    }
    let (good, bad) = health(&mut played);
    assert!(good.iter().all(|count| *count > 8), "{good:?}");
    assert_eq!(bad, [0; 3]);
    asked(&played.desk);
}

/// 255 characters take 66 ms, and RS4 waits for 50 ms for the first of them.
fn a_long_answer_is_heard_to_its_end(runner: Runner) {
    let mut played = played(runner, |request| at_once(values(request, 0)));
    for count in [87, 88, 125] {
        let request = read(2, ROUTED, count);
        expect(&mut played, Way::Rtu, &request, &values(&request, 0));
    }
    let (_, bad) = health(&mut played);
    assert_eq!(bad, [0; 3]);
    asked(&played.desk);
}

/// It begins in time, has its 257th character after 112 ms, and ends after 150.
fn what_is_too_long_for_an_answer_is_not_heard_to_its_end(runner: Runner) {
    let mut played = played(runner, |request| match first(request) {
        ROUTED => vec![(Time::from_ms(45), [&request[..1], &[3; 400]].concat())],
        _ => at_once(values(request, 0)),
    });
    let request = read(2, ROUTED, 1);
    let told = expect(&mut played, Way::Rtu, &request, &exception(&request, 0x0B));
    // Behind polls of the other two.
    let expected = Time::from_ms(110)..Time::from_ms(140);
    assert!(expected.contains(&told.turnaround), "{}", told.turnaround);
}

/// Registers of RS4: their numbers.
const SLAVEID: u16 = 5;
const STATUS: u16 = 11;
const START: u16 = 27;

/// Loads a register of RS4; whether it took the value.
fn load(played: &mut Played, number: u16, value: u32) -> bool {
    let mut request = body(OWN[0], 16, setting(RS4, number), 2);
    let answer = request.clone();
    request.push(4);
    request.extend(value.to_be_bytes());
    played.ask(Way::Rtu, &request).body == answer
}

/// Three units are polled every 100 ms, a fourth one is asked by the registers of RS4 again and again; one of the four is not
/// there. The others are asked as often as if it were.
fn one_silent_unit_among_four_holds_nobody_else_up(runner: Runner) {
    const SPAN: Time = Time::from_ms(4_000);
    for silent in [4, 2] {
        let mut played = played(runner, |request| {
            if request[0] == silent {
                return Vec::new();
            }
            at_once(values(request, 0))
        });
        assert!(load(&mut played, SLAVEID, 4));
        let begin = played.desk.bus.now();
        let mut seen = Vec::new();
        while played.desk.bus.now() < begin + SPAN {
            // Refused as long as one is under way.
            load(&mut played, START, 1);
            let asked = played.desk.bus.now();
            let told = played.ask(Way::Rtu, &read(OWN[0], setting(RS4, STATUS) + 1, 1));
            seen.push((asked, told.body[4]));
        }
        let asked = asked(&played.desk);
        let of = |unit: u8| {
            let own = asked.iter().filter(move |asked| asked.body[0] == unit);
            own.filter(|asked| (begin..begin + SPAN).contains(&asked.start))
        };
        for unit in [1, 2, 3] {
            let starts: Vec<Time> = of(unit).map(|asked| asked.start).collect();
            let periods = starts.len() as u64 - 1;
            let mean = (starts[starts.len() - 1] - starts[0]).us() / periods as f64;
            println!("unit {unit}, silent {silent}: every {mean:.0} us");
            if unit != silent {
                assert!((95_000.0..=105_000.0).contains(&mean), "unit {unit}");
            }
        }
        assert!(of(4).count() > 30, "{}", of(4).count());
        // STATUS is 2 from the end of its own request on, and 1 while it waits for its turn, whoever else is asked.
        for &(when, status) in &seen {
            let out = of(4).find(|asked| {
                let answer = asked.answered.unwrap_or(asked.over);
                when > asked.start && when + Time::from_ms(6) < answer
            });
            let near = of(4).any(|asked| {
                let over = asked.over + Time::from_ms(2);
                when + Time::from_ms(6) > asked.start && when < over
            });
            match status {
                2 => assert!(near, "{when}: 2, and nothing is out"),
                1 => assert!(
                    out.is_none_or(|out| when < out.start + Time::from_ms(4)),
                    "{when}: 1"
                ),
                _ => {}
            }
        }
        let waits = seen.iter().filter(|(_, status)| *status == 1).count();
        assert!(silent != 4 || waits > 20, "{waits} times 1");
    }
}

fn two_clients_and_the_scan_list_share_the_bus_and_nobody_waits_for_more_than_two_others(
    runner: Runner,
) {
    // Slow enough that all three always have something to ask.
    let mut played = played(runner, |request| {
        vec![(Time::from_ms(20), values(request, 0))]
    });
    let mut report = Report::default();
    let mut clients = [
        BusClient::new(played.desk.pc, AS1, Way::Rtu, LINE),
        BusClient::new(played.desk.ascii, AS2, Way::Ascii, ASCII),
    ];
    let mut rounds = [0_u16; 2];
    let span = Time::from_ms(5_000);
    let end = played.desk.bus.now() + span;
    played.run_for(span + Time::from_ms(300), |desk| {
        for (place, client) in clients.iter_mut().enumerate() {
            if client.is_free(&mut desk.bus, &mut report) && desk.bus.now() < end {
                let unit = 1 + (rounds[place] % 3) as u8;
                let at = ROUTED * (place as u16 + 1);
                let mut request = read(unit, at, 1 + rounds[place] % 5);
                let mut answer = values(&request, 0);
                if place == 1 {
                    // Renumbered there and back.
                    request[0] = unit + 10;
                    answer[0] = unit + 10;
                }
                rounds[place] += 1;
                client.ask(&mut desk.bus, request, answer, Source::Unit);
            }
        }
    });
    assert_eq!((report.lost, report.wrong), (0, 0), "{report:#?}");

    let asked = asked(&played.desk);
    let share = |at: u16| {
        asked
            .iter()
            .filter(|asked| first(&asked.body) == at)
            .count()
    };
    let [polls, of_pc, of_ascii] = [0, ROUTED, 2 * ROUTED].map(share);
    assert_eq!(polls + of_pc + of_ascii, asked.len());
    for count in [polls, of_pc, of_ascii] {
        assert!(count * 10 > asked.len() * 3, "{polls} {of_pc} {of_ascii}");
    }
    // Each has one request at a time. It waits for those of the other two that are there before it stands.
    let desk = &played.desk;
    let of_pc = frames(desk.bus.record_of(desk.wires[AS1]), LINE);
    let of_ascii = framed(desk.bus.record_of(desk.wires[AS2]), ASCII, Framing::Ascii);
    let stand = |frames: Vec<Frame>, host: HostId, line: Line| -> Vec<Time> {
        let requests = frames.iter().filter(|frame| frame.from == host.into());
        requests.map(|request| request.end() + line.t35()).collect()
    };
    for (at, stand) in [
        (ROUTED, stand(of_pc, desk.pc, LINE)),
        (2 * ROUTED, stand(of_ascii, desk.ascii, ASCII)),
    ] {
        let own = asked.iter().filter(|asked| first(&asked.body) == at);
        for (own, stands) in own.zip(stand) {
            assert!(own.start >= stands);
            let before = asked.iter().filter(|other| other.start < own.start);
            let others = before.filter(|other| other.over > stands).count();
            assert!(others <= 2, "{others} others before {own:02x?}");
        }
    }
    // The scan list is always behind its time.
    let mut others = 0;
    for asked in &asked {
        others = if first(&asked.body) == 0 {
            0
        } else {
            others + 1
        };
        assert!(others <= 2, "{others} others before {asked:02x?}");
    }
    // Every unit is polled in its turn.
    let polls = asked.iter().filter(|asked| first(&asked.body) == 0);
    let polls = polls.filter(|poll| poll.start < end);
    let units: Vec<u8> = polls.map(|poll| poll.body[0]).collect();
    assert!(units.windows(2).all(|pair| pair[1] == pair[0] % 3 + 1));
}

fn a_client_that_is_gone_keeps_nobody_and_its_answer_is_sent_to_nobody_else(runner: Runner) {
    let slow = Time::from_ms(30);
    let mut played = played(runner, |request| {
        let delay = if request[0] == 1 { slow } else { FAST };
        vec![(delay, values(request, 0))]
    });
    let own = read(OWN[0], setting(RS4, 22), 2);
    let rate = [&[OWN[0], 3, 4][..], &LINE.baud.to_be_bytes()].concat();
    for round in 0..5 {
        let lost = read(1, ROUTED + round, 2);
        // It asks for something else before the answer: of the port, of another unit, of the same.
        for (request, answer) in [
            (own.clone(), rate.clone()),
            (read(2, ROUTED, 1), values(&read(2, ROUTED, 1), 0)),
            (read(1, ROUTED, 3), values(&read(1, ROUTED, 3), 0)),
        ] {
            played
                .desk
                .bus
                .host(played.desk.pc)
                .send(&multidrop_testkit::frames::adu(&lost));
            played.run_for(Time::from_ms(12 + 2 * u64::from(round)), |_| ());
            expect(&mut played, Way::Rtu, &request, &answer);
            // Nothing comes behind.
            played.run_for(Time::from_ms(100), |_| ());
            let heard = played.desk.bus.host(played.desk.pc).take();
            assert_eq!(heard, [], "after {request:02x?}");
        }
        // It is pulled out of its socket; the other one is answered, and so is it when it is back.
        played
            .desk
            .bus
            .host(played.desk.pc)
            .send(&multidrop_testkit::frames::adu(&lost));
        played.run_for(Time::from_ms(10), |_| ());
        played.desk.bus.unplug(played.desk.pc);
        let request = read(12, ROUTED, 2);
        let mut answer = values(&read(2, ROUTED, 2), 0);
        answer[0] = 12;
        expect(&mut played, Way::Ascii, &request, &answer);
        played.run_for(Time::from_ms(60), |_| ());
        played.desk.bus.plug(played.desk.pc);
        played.run_for(Time::from_ms(5), |_| ());
        expect(&mut played, Way::Rtu, &own, &rate);
        // It asks and asks and never listens.
        for _ in 0..10 {
            played
                .desk
                .bus
                .host(played.desk.pc)
                .send(&multidrop_testkit::frames::adu(&lost));
            played.run_for(Time::from_ms(6), |_| ());
        }
        expect(&mut played, Way::Ascii, &request, &answer);
    }
    let (_, bad) = health(&mut played);
    assert_eq!(bad, [0; 3]);
    asked_or_cut(&played.desk);
}

fn units_are_renumbered_there_and_back_and_a_ports_own_unit_goes_first(runner: Runner) {
    let mut played = played(runner, |request| match first(request) {
        500 => at_once(exception(request, 2)),
        _ => at_once(values(request, 0)),
    });
    for target in 1..=3 {
        for (way, unit) in [(Way::Rtu, target), (Way::Ascii, target + 10)] {
            let mut answer = values(&read(target, ROUTED, 5), 0);
            answer[0] = unit;
            expect(&mut played, way, &read(unit, ROUTED, 5), &answer);
            let refused = read(unit, 500, 1);
            expect(&mut played, way, &refused, &exception(&refused, 2));
        }
        // Of the other port's numbers nobody knows anything.
        let other = played.ask(Way::Rtu, &read(target + 10, ROUTED, 1));
        assert_eq!(other, Told::default());
    }
    // AS2 becomes unit 12: its own register, which is 0, and unit 2 no more.
    let mut load = body(OWN[0], 16, setting(AS2, 5), 2);
    let loaded = load.clone();
    load.extend([4, 0, 0, 0, 12]);
    expect(&mut played, Way::Rtu, &load, &loaded);
    expect(&mut played, Way::Ascii, &read(12, 7, 1), &[12, 3, 2, 0, 0]);
    let mut answer = values(&read(3, ROUTED, 1), 0);
    answer[0] = 13;
    expect(&mut played, Way::Ascii, &read(13, ROUTED, 1), &answer);
    asked(&played.desk);
}

fn while_rs4_is_no_master_the_clients_are_told_so_at_once(runner: Runner) {
    let mut played = played(runner, |request| at_once(values(request, 0)));
    let load = |played: &mut Played, number, value: u32| {
        let mut request = body(OWN[0], 16, setting(RS4, number), 2);
        let answer = request.clone();
        request.push(4);
        request.extend(value.to_be_bytes());
        expect(played, Way::Rtu, &request, &answer);
    };
    // Off, and a sniffer.
    for mode in [2, 3] {
        load(&mut played, 0, mode);
        played.run_for(Time::from_ms(60), |_| ());
        let before = asked(&played.desk).len();
        for unit in 1..=3 {
            for (way, unit, line) in [(Way::Rtu, unit, LINE), (Way::Ascii, unit + 10, ASCII)] {
                let request = read(unit, ROUTED, 1);
                let told = expect(&mut played, way, &request, &exception(&request, 0x0A));
                let beyond = told.turnaround.saturating_sub(Line::t35(line));
                assert!(beyond < Time::from_ms(1), "{beyond} beyond t3.5");
            }
        }
        let own = body(OWN[0], 4, 9, 1);
        assert_eq!(played.ask(Way::Rtu, &own).body[..3], [10, 4, 2]);
        assert_eq!(asked(&played.desk).len(), before, "nothing is asked on RS4");
        load(&mut played, 0, 0);
        for round in 0..3 {
            let request = read(1 + round as u8, ROUTED + round, 1);
            expect(&mut played, Way::Rtu, &request, &values(&request, 0));
        }
        played.run_for(Time::from_ms(300), |_| ());
        assert!(asked(&played.desk).len() > before + 9, "polls go on");
    }
}
