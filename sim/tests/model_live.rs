//! The bus as a serial port: the link, and the bytes for a client.

use multidrop_testkit::places;

use std::fs::{self, OpenOptions};
use std::io::{Read, Write};
use std::os::unix::fs::symlink;
use std::path::PathBuf;

use multidrop_bus::{Bus, BusConfig, HostPort, Line, Live, LiveError, Time};

/// A path of this test's own, with nothing there.
fn path(name: &str) -> PathBuf {
    let path = places::scratch().join(format!("live-{name}-{}", std::process::id()));
    let _ = fs::remove_file(&path);
    path
}

fn live(link: &std::path::Path) -> Result<Live, LiveError> {
    let mut bus = Bus::new(BusConfig::default());
    let client = bus.add_host(HostPort::new(Line::n81(38_400)));
    Live::new(bus, client, link)
}

#[test]
fn the_link_is_made_and_goes_away() {
    let link = path("made");
    let bus = live(&link).expect("a terminal");
    assert!(fs::symlink_metadata(&link).expect("the link").is_symlink());
    drop(bus);
    assert!(fs::symlink_metadata(&link).is_err());
}

#[test]
fn a_link_of_someone_else_is_refused_and_kept() {
    let link = path("foreign");
    symlink("nowhere", &link).expect("a link");
    assert!(matches!(live(&link), Err(LiveError::ForeignLink { path, .. }) if path == link));
    let target = fs::read_link(&link).expect("a link");
    assert_eq!(target, PathBuf::from("nowhere"));
    fs::remove_file(&link).expect("a link");
}

#[test]
fn the_link_of_a_bus_that_runs_is_refused_and_free_afterwards() {
    let link = path("taken");
    let bus = live(&link).expect("a terminal");
    let target = fs::read_link(&link).expect("a link");
    assert!(matches!(live(&link), Err(LiveError::Taken(path)) if path == link));
    assert_eq!(fs::read_link(&link).expect("a link"), target);
    drop(bus);
    assert!(live(&link).is_ok());
}

#[test]
fn a_path_that_is_not_a_link_is_refused_and_kept() {
    let link = path("file");
    fs::write(&link, "mine").expect("a file");
    assert!(matches!(live(&link), Err(LiveError::NotALink(taken)) if taken == link));
    assert_eq!(fs::read_to_string(&link).expect("a file"), "mine");
    fs::remove_file(&link).expect("a file");
}

#[test]
fn clients_bytes_go_on_the_wire_and_the_next_client_gets_nothing_stale() {
    let link = path("clients");
    let mut live = live(&link).expect("a terminal");
    let other = live.bus().add_host(HostPort::new(Line::n81(38_400)));

    let open = || OpenOptions::new().read(true).write(true).open(&link);
    let mut client = open().expect("the terminal");
    client
        .write_all(&[0x03, 0x11, 0x0d, 0x0a])
        .expect("written");
    // Bytes that a terminal in its usual mode would swallow, change or echo.
    live.run(|bus| bus.host(other).heard().len() == 4)
        .expect("a bus");
    let heard: Vec<_> = live
        .bus()
        .host(other)
        .take()
        .iter()
        .map(|byte| byte.value)
        .collect();
    assert_eq!(heard, [0x03, 0x11, 0x0d, 0x0a]);

    // Heard and never read.
    live.bus().host(other).send(&[0x55; 8]);
    let until = live.bus().now() + Time::from_ms(20);
    live.run(|bus| bus.now() >= until).expect("a bus");
    assert!(live.has_client());
    drop(client);
    let until = live.bus().now() + Time::from_ms(20);
    live.run(|bus| bus.now() >= until).expect("a bus");
    assert!(!live.has_client());
    // Said while nobody listens.
    live.bus().host(other).send(&[0x66; 8]);
    let until = live.bus().now() + Time::from_ms(20);
    live.run(|bus| bus.now() >= until).expect("a bus");

    let mut client = open().expect("the terminal");
    live.bus().host(other).send(&[0x0a, 0x04, 0x77]);
    let until = live.bus().now() + Time::from_ms(20);
    live.run(|bus| bus.now() >= until).expect("a bus");
    let mut answer = [0; 16];
    let count = client.read(&mut answer).expect("read");
    assert_eq!(answer[..count], [0x0a, 0x04, 0x77]);
}
