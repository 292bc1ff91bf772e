//! The line against a plain reading of the standard, over numbered random scripts. A failure prints the number.

use multidrop_testkit::harness::book::Book;
use multidrop_testkit::harness::judge::Verdict;
use multidrop_testkit::harness::random::{self, Random};
use multidrop_testkit::harness::script::{self, Config, Op};

const SCRIPTS: u64 = 4000;

fn play(make: fn(&mut Random) -> (Config, Vec<Op>)) -> Verdict {
    let mut total = Verdict::default();
    for number in 0..SCRIPTS {
        let (config, ops) = make(&mut Random::new(number));
        let result = std::panic::catch_unwind(|| {
            let mut book = Book::new();
            if number.is_multiple_of(2) {
                script::run::<true>(&config, &ops, &mut book)
            } else {
                script::run::<false>(&config, &ops, &mut book)
            }
        });
        let verdict = result.unwrap_or_else(|_| panic!("script {number}: {config:?}"));
        total.good += verdict.good;
        total.bad += verdict.bad;
        total.answered += verdict.answered;
        total.executed += verdict.executed;
    }
    println!("{SCRIPTS} scripts: {total:?}");
    total
}

#[test]
fn fast_tasks_answer_every_good_request_on_time_and_nothing_else() {
    let total = play(random::orderly);
    assert!(total.good > 20_000 && total.bad > 10_000 && total.answered > 10_000);
}

#[test]
fn whatever_happens_no_answer_is_wrong_and_the_line_recovers() {
    let total = play(random::rough);
    assert!(total.answered > 8_000 && total.executed > 4_000);
}
