//! Every input of the committed corpus once more.

use std::fs;
use std::path::Path;

use multidrop_fuzz::TARGETS;

#[test]
fn the_corpus_holds() {
    // Where it is now: a copied checkout may have been compiled elsewhere.
    let package = std::env::var("CARGO_MANIFEST_DIR").expect("cargo runs the test");
    for (name, target) in TARGETS {
        let folder = Path::new(&package).join("corpus").join(name);
        let files = fs::read_dir(&folder).unwrap_or_else(|error| panic!("{folder:?}: {error}"));
        let mut replayed = 0;
        for file in files {
            let path = file.unwrap().path();
            let data = fs::read(&path).unwrap();
            let result = std::panic::catch_unwind(|| target(&data));
            assert!(result.is_ok(), "{}", path.display());
            replayed += 1;
        }
        println!("{name}: {replayed} inputs");
        assert!(replayed >= 10, "{name}: where is the corpus?");
    }
}
