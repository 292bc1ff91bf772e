//! The client on the Nano: every function against the conformance image, and the pause between requests.

use multidrop_bus::{
    Bus, BusConfig, Framing, HostId, HostPort, Level, Line, Nano, NodeId, Pin, Station, Time,
    framed,
};
use multidrop_testkit::frames::words;
use multidrop_testkit::{LINE, Rules, assert_bus_rules, example, image};

/// A bus with a client, its server, and a host that listens.
fn pair(client: &str, server: &str) -> (Bus, NodeId, HostId) {
    let mut bus = Bus::new(BusConfig::default());
    let client = bus
        .add_nano(Nano::new("client", image(client, &[])))
        .expect("a valid image");
    bus.add_nano(Nano::new("server", image(server, &[])))
        .expect("a valid image");
    let host = bus.add_host(HostPort::new(LINE));
    (bus, client, host)
}

/// The silences between the end of an answer and the next request, in order.
fn gaps(bus: &Bus, client: NodeId) -> Vec<Time> {
    let frames = framed(bus.record(), LINE, Framing::Rtu);
    let pairs = frames.windows(2).filter(|pair| {
        pair[0].from != Station::Node(client) && pair[1].from == Station::Node(client)
    });
    pairs.map(|pair| pair[1].start() - pair[0].end()).collect()
}

#[test]
fn the_client_calls_every_function_of_the_conformance_image_once() {
    let (mut bus, client, host) = pair("client-functions", "conformance");
    let done = |bus: &mut Bus| bus.node(client).output(Pin::B5) == Level::High;
    assert!(bus.run_until(done, Time::from_s(20)), "{}", bus.record());
    let gaps = gaps(&bus, client);
    bus.run_for(Time::from_ms(20));
    assert_bus_rules(&bus, Rules::client(LINE));
    bus.clear_record();

    let answer = bus.transact(host, &words(17, 3, 40, 41), Time::from_ms(100));
    let bytes = answer.expect("an answer").bytes;
    let outcomes: Vec<u16> = bytes[3..bytes.len() - 2]
        .chunks(2)
        .map(|word| u16::from_be_bytes([word[0], word[1]]))
        .collect();
    let mut expected = [1; 41];
    // Restart after Force Listen Only Mode is not answered; the Nano has no files; what is refused.
    expected[26] = 0x4006;
    expected[31] = 0x8001;
    expected[32] = 0x8001;
    expected[39] = 0x8002;
    expected[40] = 0x4007;
    assert_eq!(outcomes, expected);

    assert_soon(&gaps);
}

/// 125 registers take over a second at 2400 baud, and the client waits for half of one for the first of them.
#[test]
fn a_slow_line_has_time_for_the_longest_answer() {
    let slow = Line::n81(2400);
    let mut bus = Bus::new(BusConfig::default());
    let client = bus
        .add_nano(Nano::new(
            "client",
            image("client-functions", &["--baud", "2400"]),
        ))
        .expect("a valid image");
    bus.add_nano(Nano::new(
        "server",
        image("conformance", &["--baud", "2400"]),
    ))
    .expect("a valid image");
    let host = bus.add_host(HostPort::new(slow));
    let done = |bus: &mut Bus| bus.node(client).output(Pin::B5) == Level::High;
    assert!(bus.run_until(done, Time::from_s(60)), "{}", bus.record());
    bus.run_for(Time::from_ms(100));
    // What became of function 04 of 125 registers.
    let answer = bus.transact(host, &words(17, 3, 50, 1), Time::from_ms(500));
    assert_eq!(answer.expect("an answer").bytes[3..5], [0, 1]);
}

/// A request begins at t3.5 after the answer to the one before, and no later than two bit times after that.
#[track_caller]
fn assert_soon(gaps: &[Time]) {
    let (shortest, longest) = (gaps.iter().min(), gaps.iter().max());
    let (Some(&shortest), Some(&longest)) = (shortest, longest) else {
        panic!("one request at most");
    };
    let beyond = |gap: Time| gap.us() - LINE.t35().us();
    println!(
        "{} requests begin {:.1}..{:.1} us after t3.5",
        gaps.len(),
        beyond(shortest),
        beyond(longest)
    );
    assert!(shortest >= LINE.t35());
    assert!(
        longest <= LINE.t35() + LINE.bits(2),
        "{} us",
        beyond(longest)
    );
}

/// The example of the HAL reads three blocks as often as it can: 16 registers, 16 coils, one register.
#[test]
fn a_poll_list_sends_requests_without_a_pause() {
    let mut bus = Bus::new(BusConfig::default());
    let client = bus
        .add_nano(Nano::new("client", example("poll")))
        .expect("a valid image");
    let server = bus
        .add_nano(Nano::new("server", image("registers", &[])))
        .expect("a valid image");
    bus.run_for(Time::from_ms(300));
    let frames = framed(bus.record(), LINE, Framing::Rtu);
    let asked: Vec<Vec<u8>> = frames
        .iter()
        .filter(|frame| frame.from == Station::Node(client))
        .map(|frame| frame.bytes())
        .collect();
    let list = [words(1, 3, 0, 16), words(1, 1, 0, 16), words(1, 3, 15, 1)];
    assert!(asked.len() > 20);
    for round in asked.chunks(3) {
        assert_eq!(round, &list[..round.len()]);
    }
    assert_soon(&gaps(&bus, client));
    assert_eq!(bus.node(client).output(Pin::B5), Level::High);
    // Without its server, the list goes stale.
    bus.unplug(server);
    bus.run_for(Time::from_ms(400));
    assert_eq!(bus.node(client).output(Pin::B5), Level::Low);
    bus.plug(server);
    bus.run_for(Time::from_ms(400));
    assert_eq!(bus.node(client).output(Pin::B5), Level::High);
}

/// The silences between the requests of a client that nobody answers.
fn pauses(echo: bool) -> Vec<Time> {
    let mut bus = Bus::new(BusConfig::default());
    let client = bus
        .add_nano(Nano {
            echo,
            ..Nano::new("client", image("client-functions", &[]))
        })
        .expect("a valid image");
    bus.run_for(Time::from_s(10));
    let frames = framed(bus.record(), LINE, Framing::Rtu);
    assert!(frames.len() > 3, "{}", frames.len());
    assert!(
        frames
            .iter()
            .all(|frame| frame.from == Station::Node(client))
    );
    let pairs = frames.windows(2);
    pairs.map(|pair| pair[1].start() - pair[0].end()).collect()
}

/// What RXD does while a node talks is no start bit of somebody else's.
#[test]
fn a_client_with_an_echo_waits_no_longer_than_one_without() {
    let quiet = pauses(false);
    for (echoed, quiet) in pauses(true).into_iter().zip(quiet) {
        assert!(
            echoed < quiet + LINE.bits(1),
            "{echoed} in place of {quiet}"
        );
    }
}
