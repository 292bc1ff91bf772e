//! Several clients on one bus behind RS4: who waits for whom.
use multidrop_bus::{Frame, Framing, HostId, Line, Time, framed, frames};
use multidrop_testkit::four::units::{Played, Told, asked, asked_or_cut};
use multidrop_testkit::four::{AS1, AS2, ASCII, BusClient, LINE, RS4, Report, Source, setting};
use multidrop_testkit::plain::wire::Way;
use multidrop_testkit::{Runner, on_both};
use routes::{
    FAST, OWN, ROUTED, SLAVEID, START, STATUS, at_once, body, exception, expect, first, health,
    load, played, read, values,
};

mod routes;

on_both! {
    one_silent_unit_among_four_holds_nobody_else_up,
    two_clients_and_the_scan_list_share_the_bus_and_nobody_waits_for_more_than_two_others,
    a_client_that_is_gone_keeps_nobody_and_its_answer_is_sent_to_nobody_else,
    units_are_renumbered_there_and_back_and_a_ports_own_unit_goes_first,
    while_rs4_is_no_master_the_clients_are_told_so_at_once,
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
