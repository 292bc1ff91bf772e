//! Names, options and refusals of images.

use super::*;

fn nano(app: App, options: Options) -> Result<Image, Error> {
    Image::new(Board::Nano, app, options)
}

fn refusal(result: Result<Image, Error>) -> String {
    let error = result.expect_err("accepted");
    assert_eq!(error.code(), 2);
    error.message().to_owned()
}

#[test]
fn names_hold_the_options_given_in_a_fixed_order() {
    let plain = nano(App::DemoUnit, Options::default()).unwrap();
    assert_eq!(
        plain.elf().to_str(),
        Some("target/firmware/nano-demo-unit.elf")
    );
    let full = Options {
        count: Some(128),
        baud: Some(115_200),
        format: Some(Format::Bits8Even1),
        ..Options::default()
    };
    assert_eq!(
        nano(App::Registers, full).unwrap().stem(),
        "nano-registers-count128-baud115200-format8E1"
    );
    let second = Options {
        unit: Some(2),
        ..Options::default()
    };
    assert_eq!(
        nano(App::DemoUnit, second).unwrap().stem(),
        "nano-demo-unit-unit2"
    );
}

#[test]
fn options_not_given_are_withheld_from_the_build() {
    let baud = Options {
        baud: Some(9_600),
        ..Options::default()
    };
    let environment = nano(App::Registers, baud).unwrap().environment();
    assert_eq!(
        environment,
        [
            ("MULTIDROP_UNIT".to_owned(), None),
            ("MULTIDROP_COUNT".to_owned(), None),
            ("MULTIDROP_BAUD".to_owned(), Some("9600".to_owned())),
            ("MULTIDROP_FORMAT".to_owned(), None),
            ("MULTIDROP_CLOCK".to_owned(), None),
            ("MULTIDROP_ASCII".to_owned(), None),
            ("MULTIDROP_BOOTLOADER".to_owned(), None),
        ]
    );
}

#[test]
fn guards_are_an_option_of_the_yardstick_and_the_boot_loader_one_of_the_nano() {
    let guarded = Options {
        guarded: true,
        ..Options::default()
    };
    let plain = nano(App::Registers, Options::default()).unwrap();
    assert_eq!(plain.features(), (true, vec!["bare"]));
    let image = nano(App::Registers, guarded).unwrap();
    assert_eq!(image.stem(), "nano-registers-guarded");
    assert_eq!(image.features(), (true, vec![]));
    assert!(refusal(nano(App::DemoUnit, guarded)).contains("--guarded"));

    let old = nano(App::DemoUnit, Options::default())
        .unwrap()
        .with_bootloader(Bootloader::Old);
    assert_eq!(old.stem(), "nano-demo-unit-bootloaderold");
    let handed = ("MULTIDROP_BOOTLOADER".to_owned(), Some("old".to_owned()));
    assert!(old.environment().contains(&handed) && old.lacks_watchdog());
    assert!(!old.with_bootloader(Bootloader::New).lacks_watchdog());
    // Nothing is left out of an image that has none.
    assert!(!plain.with_bootloader(Bootloader::Old).lacks_watchdog());
    let stm32 = Options {
        bootloader: Some(Bootloader::New),
        ..Options::default()
    };
    let text = refusal(Image::new(Board::Stm32, App::DemoUnit, stm32));
    assert!(text.contains("--bootloader"), "{text}");
}

#[test]
fn a_baud_off_by_more_than_the_limit_names_the_nearest() {
    let with = |baud| {
        nano(
            App::Registers,
            Options {
                baud: Some(baud),
                ..Options::default()
            },
        )
    };
    assert!(with(115_200).is_ok(), "2.1 % off and in use everywhere");
    let text = refusal(with(921_600));
    assert!(
        text.contains("--baud 921600") && text.ends_with("1000000"),
        "{text}"
    );
    for outside in [0, 299, 1_000_001, 2_000_000] {
        let text = refusal(with(outside));
        assert!(text.contains("300..=1000000"), "{text}");
    }
    let text = refusal(with(300));
    assert!(
        text.contains("--baud 300") && text.ends_with("307"),
        "{text}"
    );
    assert!(with(600).is_ok() && with(1_000_000).is_ok());
}

#[test]
fn the_baud_is_checked_against_the_clock_asked_for() {
    let with = |clock, baud| {
        let options = Options {
            baud,
            clock: Some(clock),
            ..Options::default()
        };
        nano(App::Registers, options)
    };
    let exact = with(11_059_200, Some(921_600));
    assert!(refusal(exact).contains("11059200 Hz"), "1/12 of the clock");
    let image = with(11_059_200, Some(115_200)).unwrap();
    assert_eq!(image.stem(), "nano-registers-baud115200-clock11059200");
    // 8 MHz / 16 / 4 is 8.5 % off 115200, and 8 MHz / 8 / 9 is 3.5 % off.
    assert!(refusal(with(8_000_000, Some(115_200))).contains("111111"));
    assert!(with(8_000_000, None).is_ok());
}

#[test]
fn formats_of_seven_bits_are_for_ascii() {
    let with = |format| {
        nano(
            App::Registers,
            Options {
                format: Some(format),
                ..Options::default()
            },
        )
    };
    assert!(with(Format::Bits8None2).is_ok());
    assert!(refusal(with(Format::Bits7Even1)).contains("7E1"));
    let ascii = Options {
        baud: Some(19_200),
        format: Some(Format::Bits7Even1),
        ascii: true,
        ..Options::default()
    };
    let image = nano(App::Conformance, ascii).unwrap();
    assert_eq!(image.stem(), "nano-conformance-baud19200-format7E1-ascii");
    assert!(
        image
            .environment()
            .contains(&("MULTIDROP_ASCII".to_owned(), Some("1".to_owned())))
    );
    let text = refusal(nano(App::Registers, ascii));
    assert_eq!(
        text,
        "--ascii: registers is built for RTU only; use conformance"
    );
    let rtu = Options {
        ascii: false,
        ..ascii
    };
    assert!(refusal(nano(App::Conformance, rtu)).contains("--ascii"));
}

#[test]
fn an_application_that_is_not_in_this_version_is_refused() {
    let panel = refusal(Image::new(
        Board::Stm32,
        App::RelayPanel,
        Options::default(),
    ));
    assert!(panel.contains("stm32 has no application relay-panel in this version"));
    let node = refusal(nano(App::SensorNode, Options::default()));
    assert!(node.contains("nano has no application sensor-node in this version"));
}

#[test]
fn an_option_of_another_application_is_refused() {
    let unit = Options {
        unit: Some(2),
        ..Options::default()
    };
    assert!(refusal(nano(App::Registers, unit)).starts_with("--unit"));
    let count = Options {
        count: Some(2),
        ..Options::default()
    };
    assert!(refusal(nano(App::DemoUnit, count)).starts_with("--count"));
}
