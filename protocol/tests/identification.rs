//! Read Device Identification (APP 6.21) of devices with few and many objects, and with more than fit in an answer.

use multidrop_protocol::Adu;
use multidrop_protocol::data::BytesOut;
use multidrop_protocol::server::{Conformity, DataModel, FunctionSet, Server};

/// A device with these objects, all of this length, whose bytes are their id.
macro_rules! device {
    ($name:ident, $conformity:expr, $ids:pat, $len:expr) => {
        struct $name;
        impl DataModel for $name {
            const FUNCTIONS: FunctionSet = FunctionSet::ALL;
            const CONFORMITY: Conformity = $conformity;
            fn device_object(&mut self, id: u8, out: &mut BytesOut<'_>) -> bool {
                if !matches!(id, $ids) {
                    return false;
                }
                for _ in 0..$len {
                    out.push(id);
                }
                true
            }
        }
    };
}

device!(Basic, Conformity::Basic, 0..=6 | 0x80..=0x83, 3);
device!(Regular, Conformity::Regular, 0..=6 | 0x80..=0x83, 3);
device!(Extended, Conformity::Extended, 0..=8 | 0x7F..=0x83 | 0xFE..=0xFF, 3);
device!(Long, Conformity::Extended, 0..=2 | 0x80..=0x84 | 0xFF, 100);
device!(TooLong, Conformity::Basic, 0..=2, 245);
device!(JustFits, Conformity::Basic, 0..=2, 244);

/// The answer to code and object id, without unit id.
fn ask<M: DataModel>(mut model: M, code: u8, object: u8) -> Vec<u8> {
    let server = Server::new(1);
    let mut adu: Adu = [0xA5; 256];
    adu[..5].copy_from_slice(&[1, 0x2B, 0x0E, code, object]);
    let plan = server.prepare(&mut model, &mut adu, 5);
    let len = server.commit(&mut model, &mut adu, 5, plan);
    adu[1..len.into()].to_vec()
}

/// Conformity, more follows, next object; ids and lengths of the objects, whose bytes are looked at here.
fn told<M: DataModel>(model: M, code: u8, object: u8) -> ([u8; 3], Vec<(u8, usize)>) {
    let answer = ask(model, code, object);
    assert_eq!(answer[..3], [0x2B, 0x0E, code]);
    let (head, mut rest) = ([answer[3], answer[4], answer[5]], &answer[7..]);
    let mut objects = Vec::new();
    while let [id, len, more @ ..] = rest {
        let (value, more) = more.split_at((*len).into());
        assert!(value.iter().all(|byte| byte == id), "{answer:02X?}");
        objects.push((*id, value.len()));
        rest = more;
    }
    assert_eq!(objects.len(), usize::from(answer[6]));
    (head, objects)
}

fn of_3(ids: impl IntoIterator<Item = u8>) -> Vec<(u8, usize)> {
    ids.into_iter().map(|id| (id, 3)).collect()
}

#[test]
fn each_level_has_its_own_objects_only() {
    for object in [0, 3, 7, 0x80, 0xFF] {
        assert_eq!(told(Basic, 1, object), ([0x81, 0, 0], of_3(0..=2)));
        assert_eq!(told(Basic, 2, object), ([0x81, 0, 0], of_3(0..=2)));
        assert_eq!(told(Basic, 3, object), ([0x81, 0, 0], of_3(0..=2)));
    }
    assert_eq!(told(Regular, 1, 0), ([0x82, 0, 0], of_3(0..=2)));
    assert_eq!(told(Regular, 2, 0), ([0x82, 0, 0], of_3(0..=6)));
    // Without extended objects code 3 answers as code 2 (the device has some, and its conformity says that it does not tell).
    assert_eq!(told(Regular, 3, 0), ([0x82, 0, 0], of_3(0..=6)));
    assert_eq!(told(Regular, 3, 0x80), ([0x82, 0, 0], of_3(0..=6)));
    let all = (0..=6).chain(0x80..=0x83).chain(0xFE..=0xFF);
    assert_eq!(told(Extended, 1, 0), ([0x83, 0, 0], of_3(0..=2)));
    assert_eq!(told(Extended, 2, 0), ([0x83, 0, 0], of_3(0..=6)));
    assert_eq!(told(Extended, 3, 0), ([0x83, 0, 0], of_3(all)));
}

#[test]
fn a_stream_begins_where_it_is_asked_to_or_at_the_beginning() {
    assert_eq!(told(Extended, 1, 2).1, of_3([2]));
    assert_eq!(told(Extended, 2, 5).1, of_3(5..=6));
    assert_eq!(told(Extended, 3, 0x82).1, of_3([0x82, 0x83, 0xFE, 0xFF]));
    assert_eq!(told(Extended, 3, 0xFF).1, of_3([0xFF]));
    // Not of the level, reserved, or not there: from object 0.
    assert_eq!(told(Extended, 1, 3).1, of_3(0..=2));
    assert_eq!(told(Extended, 2, 0x80).1, of_3(0..=6));
    assert_eq!(told(Extended, 3, 7).1.len(), 13);
    assert_eq!(told(Extended, 3, 0x84).1.len(), 13);
}

#[test]
fn an_object_of_any_level_can_be_read_individually() {
    for id in [0, 2, 6, 7, 0x7F, 0x80, 0xFF] {
        assert_eq!(told(Extended, 4, id), ([0x83, 0, 0], of_3([id])));
    }
    assert_eq!(told(Basic, 4, 0x83), ([0x81, 0, 0], of_3([0x83])));
    for id in [9, 0x84, 0xFD] {
        assert_eq!(ask(Extended, 4, id), [0xAB, 2]);
    }
    assert_eq!(ask(Basic, 4, 7), [0xAB, 2]);
}

#[test]
fn objects_that_do_not_fit_follow_in_the_next_answer() {
    let long = |ids: &[u8]| ids.iter().map(|id| (*id, 100)).collect::<Vec<_>>();
    assert_eq!(told(Long, 1, 0), ([0x83, 0xFF, 2], long(&[0, 1])));
    assert_eq!(told(Long, 1, 2), ([0x83, 0, 0], long(&[2])));
    let mut next = 0;
    let mut seen = Vec::new();
    loop {
        let ([_, more, following], objects) = told(Long, 3, next);
        seen.extend(objects);
        if more == 0 {
            assert_eq!(following, 0);
            break;
        }
        assert_eq!(more, 0xFF);
        assert!(following > next);
        next = following;
    }
    assert_eq!(seen, long(&[0, 1, 2, 0x80, 0x81, 0x82, 0x83, 0x84, 0xFF]));
}

#[test]
fn an_object_that_fits_no_answer_is_a_failure_and_no_endless_stream() {
    assert_eq!(told(JustFits, 4, 1).1, [(1, 244)]);
    assert_eq!(told(JustFits, 1, 0), ([0x81, 0xFF, 1], vec![(0, 244)]));
    assert_eq!(ask(TooLong, 4, 1), [0xAB, 4]);
    assert_eq!(ask(TooLong, 1, 0), [0xAB, 4]);
}
