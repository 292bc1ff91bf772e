//! Requests per second and core.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use host_bench::{Answers, Ours, Request, Rmodbus};

fn requests(criterion: &mut Criterion) {
    assert!(host_bench::agree());
    let mut group = criterion.benchmark_group("server");
    group.throughput(Throughput::Elements(1));
    for request in Request::ALL {
        let frame = request.frame();
        let mut ours = Ours::new();
        group.bench_function(format!("ours-{}", request.name()), |bencher| {
            bencher.iter(|| ours.answer(black_box(&frame)).len());
        });
        let mut theirs = Rmodbus::new();
        group.bench_function(format!("rmodbus-{}", request.name()), |bencher| {
            bencher.iter(|| theirs.answer(black_box(&frame)).len());
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .warm_up_time(std::time::Duration::from_millis(500))
        .measurement_time(std::time::Duration::from_secs(2));
    targets = requests
}
criterion_main!(benches);
