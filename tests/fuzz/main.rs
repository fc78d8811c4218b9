//! No file makes a parser panic, hang or ask for memory that it could not fill; what is refused is refused
//! by name, and what is let through is sound.
//!
//! Every parser that a file can reach is given small sound files and the kept files of `tests/corpus/`,
//! damaged (see `mutate`). By default each runs for a fixed number of inputs, all together in less than
//! 20 s of a release build. For longer:
//!
//! ```text
//! TURNLIGHT_FUZZ_SECONDS=1800 cargo test --release --test fuzz -- --nocapture      each parser half an hour
//! TURNLIGHT_FUZZ_INPUT=4711 cargo test --release --test fuzz ply                   one input again
//! ```
//!
//! A failure says its parser and number, and leaves the input in `target/tmp/`. The number stands for the
//! same input as long as seeds and corpus are the same. After an abort, the input is the file left in the
//! temporary folder `turnlight-fuzz-PARSER…`. What was found and mended is kept in `tests/corpus/PARSER/`.

#![expect(clippy::unwrap_used, reason = "a test may stop at once")]
#![expect(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a long run says what it did"
)]

mod brackets;
mod cameras;
mod folders;
mod images;
mod memory;
mod meshes;
mod mutate;
#[path = "../photographs/mod.rs"]
mod photographs;
mod room;
mod scenes;
mod seeds;

use std::panic::{self, AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use mutate::Form;

/// Longest time for one file.
const HANG: Duration = Duration::from_secs(5);

/// How much memory a file may take, bytes.
#[derive(Clone, Copy)]
struct Room {
    /// Whatever its length.
    flat: usize,
    /// For each of its bytes: images may be small files of many equal pixels.
    per_byte: usize,
}

/// A parser and the files to begin from.
struct Parser {
    /// Its name, and that of its folder in the corpus.
    name: &'static str,
    /// What a file is called when it is read.
    file: &'static str,
    /// How it is damaged.
    form: Form,
    /// Sound files.
    seeds: Vec<Vec<u8>>,
    /// Memory allowed.
    room: Room,
    /// How many inputs are tried by default.
    inputs: u64,
}

/// One parser at a time: memory is counted for the whole process, and panics are kept quiet.
static RUNNING: Mutex<()> = Mutex::new(());

/// What is being read since when, and what the last panic said.
static CURRENT: Mutex<Option<(String, Instant)>> = Mutex::new(None);
static LAST_PANIC: Mutex<String> = Mutex::new(String::new());

fn lock<T>(mutex: &'static Mutex<T>) -> MutexGuard<'static, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Ends the process where a file is read for much too long; such a thread cannot be stopped otherwise.
static WATCH: LazyLock<()> = LazyLock::new(|| {
    std::thread::spawn(|| {
        loop {
            std::thread::sleep(HANG / 5);
            if let Some((input, since)) = &*lock(&CURRENT)
                && since.elapsed() > 4 * HANG
            {
                eprintln!("{input} hangs");
                std::process::abort();
            }
        }
    });
});

/// Decoders of other crates panic, and are caught: only what a test says itself is printed.
static QUIET: LazyLock<()> = LazyLock::new(|| {
    let loud = panic::take_hook();
    panic::set_hook(Box::new(move |what| {
        if lock(&CURRENT).is_some() {
            *lock(&LAST_PANIC) = what.to_string();
        } else {
            loud(what);
        }
    }));
});

/// What became of a file: read, or refused with these words.
type Outcome = Result<(), String>;

/// Reads damaged files with `read`, in a folder that `prepare` has filled with the files beside them.
fn fuzz(mut parser: Parser, prepare: impl Fn(&Path), read: impl Fn(&Path) -> Outcome) {
    let _alone = lock(&RUNNING);
    LazyLock::force(&WATCH);
    LazyLock::force(&QUIET);
    let sound = parser.seeds.len() as u64;
    parser.seeds.extend(corpus(parser.name));
    let folder = tempfile::Builder::new()
        .prefix(&format!("turnlight-fuzz-{}-", parser.name))
        .tempdir()
        .unwrap();
    prepare(folder.path());
    let path = folder.path().join(parser.file);

    let number = |name: &str| {
        std::env::var(name)
            .ok()
            .map(|text| text.parse::<u64>().unwrap())
    };
    let seconds = number("TURNLIGHT_FUZZ_SECONDS").map(Duration::from_secs);
    let numbers = match (number("TURNLIGHT_FUZZ_INPUT"), seconds) {
        (Some(only), _) => only..only + 1,
        (None, Some(_)) => 0..u64::MAX,
        (None, None) => 0..parser.inputs,
    };
    let started = Instant::now();
    let (mut inputs, mut accepted, mut most_memory) = (0u64, 0u64, 0);
    for number in numbers {
        if seconds.is_some_and(|seconds| started.elapsed() > seconds) {
            break;
        }
        let input = mutate::input(parser.name, parser.form, &parser.seeds, number);
        let trial = read_once(
            &path,
            &input,
            &format!("{} input {number}", parser.name),
            &read,
        );
        (inputs, most_memory) = (inputs + 1, most_memory.max(trial.memory));
        accepted += u64::from(trial.outcome.is_ok());
        let most = parser.room.flat + parser.room.per_byte * input.len();
        let refused_seed = number < sound && trial.outcome.is_err();
        if let Some(complaint) = trial.complaint(&path, refused_seed, most) {
            let kept = Path::new(env!("CARGO_TARGET_TMPDIR"))
                .join(format!("fuzz-{}-{number}", parser.name))
                .with_extension(path.extension().unwrap());
            std::fs::write(&kept, &input).unwrap();
            panic!(
                "{} input {number}, kept as {}: {complaint}",
                parser.name,
                kept.display()
            );
        }
    }
    println!(
        "{}: {inputs} inputs ({accepted} accepted) in {:.1} s, at most {:.1} MB",
        parser.name,
        started.elapsed().as_secs_f64(),
        most_memory as f64 / 1e6
    );
}

/// How one file was read.
struct Trial {
    outcome: Outcome,
    panicked: bool,
    elapsed: Duration,
    /// Most bytes in use at once beyond those before.
    memory: usize,
}

fn read_once(path: &Path, input: &[u8], what: &str, read: &impl Fn(&Path) -> Outcome) -> Trial {
    // A new file each time: some file systems wait for the disk when one is overwritten.
    let _ = std::fs::remove_file(path);
    std::fs::write(path, input).unwrap();
    let started = Instant::now();
    *lock(&CURRENT) = Some((what.to_owned(), started));
    let before = memory::start_peak();
    let caught = catch_unwind(AssertUnwindSafe(|| read(path)));
    let memory = memory::peak().saturating_sub(before);
    *lock(&CURRENT) = None;
    Trial {
        panicked: caught.is_err(),
        outcome: caught.unwrap_or_else(|_| Err(lock(&LAST_PANIC).clone())),
        elapsed: started.elapsed(),
        memory,
    }
}

impl Trial {
    /// What must not be, if anything.
    fn complaint(&self, path: &Path, refused_seed: bool, most_memory: usize) -> Option<String> {
        let name = path.file_name().unwrap().to_str().unwrap();
        match &self.outcome {
            Err(panic) if self.panicked => Some(panic.clone()),
            Err(error) if refused_seed => Some(format!("a sound seed is refused: {error}")),
            Err(error) if !error.contains(name) => {
                Some(format!("the error names no file: {error}"))
            }
            _ if self.elapsed > HANG => Some(format!("took {:?}", self.elapsed)),
            _ if self.memory > most_memory => Some(format!("took {} bytes of memory", self.memory)),
            _ => None,
        }
    }
}

/// The parsers of which files are kept.
const KEPT: [&str; 6] = [
    "capture",
    "map",
    "photograph",
    "points",
    "property",
    "scene",
];

#[test]
fn every_kept_file_has_its_parser() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus");
    let mut folders: Vec<String> = std::fs::read_dir(corpus)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    folders.sort();
    assert_eq!(folders, KEPT);
}

/// The kept files of a parser, in the order of their names.
fn corpus(parser: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/corpus")
        .join(parser);
    if !KEPT.contains(&parser) {
        return Vec::new();
    }
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    paths.sort();
    paths
        .iter()
        .map(|path| std::fs::read(path).unwrap())
        .collect()
}
