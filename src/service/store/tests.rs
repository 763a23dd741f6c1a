//! The store over real folders.

use super::*;
use crate::protocol::MAX_FETCH_BYTES;
use crate::runtime::StopReason;

const MB: u64 = 1 << 20;

fn id(name: &str) -> RunId {
    RunId::new(name).unwrap()
}

fn over(reason: StopReason) -> LastStop {
    LastStop::new(None, "m", reason.into())
}

/// A run that was begun, has this many bytes, and is over.
fn run(store: &Store, name: &str, bytes: usize) {
    let file = store.begin(Record::new(id(name), "m", 60.0, "pc")).unwrap();
    std::fs::write(file, vec![7; bytes]).unwrap();
    store.end(&id(name), Some(over(StopReason::Finished)), Some(1.5), Some(3));
}

fn names(store: &Store) -> Vec<String> {
    store.list().iter().map(|info| info.run.to_string()).collect()
}

fn fetch(store: &Store, name: &str, offset: u64) -> Result<(Fetched, Vec<u8>), StoreError> {
    store.fetch(&Fetch::part(&id(name), offset, u32::MAX))
}

#[test]
fn a_run_is_listed_and_found_again_by_the_next_service() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path(), 64 * MB).unwrap();
    run(&store, "one", 10);
    run(&store, "two", 20);
    store.begin(Record::new(id("three"), "m", 60.0, "pc")).unwrap();
    assert_eq!(names(&store), ["three", "two", "one"]);
    assert!(store.list()[0].going_on && !store.list()[1].going_on);
    assert!(
        matches!(Store::open(folder.path(), 64 * MB), Err(StoreError::Kept(_))),
        "one service a folder"
    );
    let before = store.list();
    drop(store);
    let store = Store::open(folder.path(), 64 * MB).unwrap();
    assert_eq!(&store.list()[1..], &before[1..]);
    assert_eq!(store.list().iter().map(|info| info.number).collect::<Vec<_>>(), [3, 2, 1]);
    let cut = &store.list()[0];
    assert!(
        !cut.going_on && cut.end.is_none(),
        "a run that a dead service leaves is listed as cut: {cut:?}"
    );
    assert_eq!(store.open_ended().len(), 1);
}

#[test]
fn a_deleted_run_is_remembered_with_its_number() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path(), 64 * MB).unwrap();
    run(&store, "one", 10);
    store.delete(&id("one")).unwrap();
    assert!(matches!(store.delete(&id("one")), Err(StoreError::Unknown(_))));
    assert!(store.knows(&id("one")) && names(&store).is_empty());
    drop(store);
    // A deletion that a power cut interrupted: the folder is still there.
    std::fs::create_dir(folder.path().join("one")).unwrap();
    let store = Store::open(folder.path(), 64 * MB).unwrap();
    assert!(store.knows(&id("one")) && !store.knows(&id("two")) && names(&store).is_empty());
    assert!(!folder.path().join("one").exists(), "and is finished");
    run(&store, "two", 10);
    assert_eq!(store.list()[0].number, 2, "numbers count up over deleted runs");
}

#[test]
fn fetched_runs_go_first_then_the_oldest_and_the_running_one_never() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path(), 16 * MB).unwrap();
    for name in ["a", "b", "c"] {
        run(&store, name, 3 << 20);
    }
    while store.hash_one() {}
    // A client has all of b; all of c was handed out; of a, a client has something else.
    let all = |name: &str| {
        let mut offset = 0;
        while offset < 3 * MB {
            offset += u64::from(fetch(&store, name, offset).unwrap().0.length);
        }
        fetch(&store, name, offset).unwrap().0.sha256.unwrap()
    };
    let has = |name: &str, sha256: &str| {
        let whole = Fetch { sha256: Some(sha256.to_owned()), ..Fetch::part(&id(name), 3 * MB, 0) };
        store.fetch(&whole).unwrap();
    };
    let sha256 = all("b");
    has("b", &sha256);
    all("c");
    has("a", &"0".repeat(64));
    assert_eq!(
        store.list().iter().map(|info| info.fetched).collect::<Vec<_>>(),
        [false, true, false]
    );
    run(&store, "d", 3 << 20);
    assert_eq!(names(&store), ["d", "c", "a"], "b was fetched");
    let file = store.begin(Record::new(id("e"), "m", 60.0, "pc")).unwrap();
    assert_eq!(names(&store), ["e", "d", "c"], "then a, the oldest");
    std::fs::write(&file, vec![7; 20 << 20]).unwrap();
    store.grow();
    assert_eq!(names(&store), ["e"], "the running one makes the others go and stays itself");
    assert!(matches!(store.delete(&id("e")), Err(StoreError::GoingOn(_))));
}

#[test]
fn a_run_is_fetched_while_it_grows_and_ends_with_the_hash_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path(), 64 * MB).unwrap();
    let file = store.begin(Record::new(id("r"), "m", 60.0, "pc")).unwrap();
    assert_eq!(fetch(&store, "r", 0).unwrap().0.total, 0, "nothing is there yet");
    let bytes: Vec<u8> = (0..600_000_u32).map(|at| at.to_le_bytes()[1]).collect();
    std::fs::write(&file, &bytes[..300_000]).unwrap();
    let (first, mut got) = fetch(&store, "r", 0).unwrap();
    assert_eq!((first.length, first.total, first.complete), (MAX_FETCH_BYTES, 300_000, false));
    std::fs::write(&file, &bytes).unwrap();
    assert!(!store.hash_one(), "what still grows is not hashed");
    store.end(&id("r"), Some(over(StopReason::Button)), None, None);
    let early = fetch(&store, "r", 600_000).unwrap().0;
    assert!(early.complete && early.sha256.is_none(), "not computed yet: ask again");
    assert!(store.hash_one() && !store.hash_one(), "once");
    loop {
        let (part, more) = fetch(&store, "r", got.len() as u64).unwrap();
        got.extend(more);
        if let Some(sha256) = part.sha256 {
            assert_eq!(sha256, crate::service::digest::sha256_hex(&bytes));
            break;
        }
        assert!(got.len() < bytes.len());
    }
    assert!(got == bytes);
    let beyond = fetch(&store, "r", 600_001).unwrap_err();
    assert!(
        matches!(beyond, StoreError::BeyondEnd { offset: 600_001, total: 600_000 }),
        "{beyond}"
    );
    assert!(matches!(fetch(&store, "no", 0), Err(StoreError::Unknown(_))));
}

#[test]
fn what_is_not_ours_in_the_folder_is_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["lost+found", "notes", "other"] {
        std::fs::create_dir(folder.path().join(name)).unwrap();
    }
    std::fs::write(folder.path().join("notes/run.json"), b"{\"run\": 3").unwrap();
    std::fs::write(folder.path().join("file"), b"").unwrap();
    std::fs::write(folder.path().join("deleted"), b"a 1\nnonsense\n../x 2\nb\n\xff\nc 4\n")
        .unwrap();
    let store = Store::open(folder.path(), 64 * MB).unwrap();
    assert!(names(&store).is_empty());
    assert_eq!(["a", "b", "c"].map(|name| store.knows(&id(name))), [true, false, true]);
    let error = store.begin(Record::new(id("notes"), "m", 60.0, "pc")).unwrap_err();
    assert!(
        error.to_string().contains("cannot make"),
        "a folder that is there is not taken: {error}"
    );
    assert!(folder.path().join("notes/run.json").exists());
}

#[test]
fn a_folder_that_cannot_be_used_is_trouble_that_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, b"").unwrap();
    let store = Store::open(&file, 64 * MB).unwrap();
    let trouble = store.trouble().unwrap().to_string();
    assert!(trouble.starts_with("cannot make "), "{trouble}");
    store.begin(Record::new(id("r"), "m", 60.0, "pc")).unwrap_err();
    let good = Store::open(&folder.path().join("runs"), 64 * MB).unwrap();
    assert!(good.trouble().is_none());
}

/// A run's end, its hash and a fetch are noted by three threads of the service, and all write its
/// `run.json`.
#[test]
fn what_several_threads_note_of_a_run_is_all_on_the_disk() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path(), 64 * MB).unwrap();
    for at in 0..50 {
        let name = format!("run-{at}");
        std::fs::write(store.begin(Record::new(id(&name), "m", 60.0, "pc")).unwrap(), [7]).unwrap();
        lock(&store.index).going_on = None;
        let ready = std::sync::Barrier::new(3);
        std::thread::scope(|scope| {
            let first_all = |note: fn(&Store, &RunId)| {
                let (store, ready, run) = (&store, &ready, id(&name));
                scope.spawn(move || {
                    ready.wait();
                    note(store, &run);
                });
            };
            first_all(|store, run| {
                store.end(run, Some(over(StopReason::Abandoned)), Some(1.5), Some(3))
            });
            first_all(|store, run| {
                store.change(run, |record| record.sha256 = Some("0".repeat(64)))
            });
            first_all(|store, run| store.change(run, |record| record.fetched = true));
        });
        let saved = files::read(&store.folder_of(&id(&name))).unwrap();
        assert_eq!(&saved, &lock(&store.index).find(&id(&name)).unwrap().record, "after {at} runs");
    }
}
