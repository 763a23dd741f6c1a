//! Recordings that come home whatever happens on the way.

use std::io::{Read as _, Write as _};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use onbrick::link::{ClientError, Patience};
use onbrick::protocol::{Kind, RunId};

use super::bench::{Bench, LONG, client_at, serve, until};

fn run(name: &str) -> RunId {
    RunId::new(name).unwrap()
}

/// Bytes that repeat nowhere.
fn bytes(length: usize, seed: u64) -> Vec<u8> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state.to_le_bytes()[3]
    };
    (0..length).map(|_| next()).collect()
}

/// A connection to a brick that is cut again and again, after another number of bytes each time.
struct CutWay {
    address: SocketAddr,
    cuts: Arc<AtomicU32>,
}

impl CutWay {
    fn to(to: String, most_cuts: u32) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let cuts = Arc::new(AtomicU32::new(0));
        let counted = Arc::clone(&cuts);
        std::thread::spawn(move || {
            for near in listener.incoming() {
                let Ok(near) = near else { return };
                let Ok(far) = TcpStream::connect(&to) else { continue };
                let cut = counted.load(Ordering::Relaxed);
                // The handshake and at least a piece come through.
                let left = if cut < most_cuts {
                    70_000 + cut as usize * 7919 % 90_000
                } else {
                    usize::MAX
                };
                let up = (near.try_clone().unwrap(), far.try_clone().unwrap());
                std::thread::spawn(move || carry(up.0, up.1, usize::MAX));
                let counted = Arc::clone(&counted);
                std::thread::spawn(move || {
                    if carry(far, near, left) {
                        counted.fetch_add(1, Ordering::Relaxed);
                    }
                });
            }
        });
        Self { address, cuts }
    }
}

/// Carries this many bytes; true if this limit ended it.
fn carry(mut from: TcpStream, mut to: TcpStream, mut left: usize) -> bool {
    let mut piece = [0; 4096];
    let mut ran_out = false;
    while let Ok(read @ 1..) = from.read(&mut piece) {
        if read > left {
            ran_out = true;
            break;
        }
        left -= read;
        if to.write_all(&piece[..read]).is_err() {
            break;
        }
    }
    let _ = (from.shutdown(Shutdown::Both), to.shutdown(Shutdown::Both));
    ran_out
}

struct Home {
    _folder: tempfile::TempDir,
    file: PathBuf,
    part: PathBuf,
}

fn home() -> Home {
    let folder = tempfile::tempdir().unwrap();
    let (file, part) = (folder.path().join("r.mcap"), folder.path().join("r.mcap.part"));
    Home { _folder: folder, file, part }
}

#[test]
fn a_recording_comes_byte_for_byte_and_has_its_name_only_when_it_is_whole() {
    let bench = Bench::new();
    let home = home();
    for length in [0, 1, 65_536, 65_537, 1_000_003] {
        let sent = bytes(length, 1);
        bench.fake.record("r", sent.clone(), true);
        let mut last = None;
        let whole = bench
            .client()
            .fetch(&run("r"), &home.file, &mut |progress| last = Some(*progress))
            .unwrap();
        assert_eq!(std::fs::read(&home.file).unwrap(), sent, "{length}");
        assert!(whole.is_whole() && last == Some(whole), "{whole:?} {last:?}");
        assert!(!home.part.exists());
        std::fs::remove_file(&home.file).unwrap();
    }
    let missing = bench.client().fetch(&run("other"), &home.file, &mut |_| {}).unwrap_err();
    assert!(
        matches!(missing, ClientError::Refused(ref refusal) if refusal.kind == Kind::UnknownRun),
        "{missing}"
    );
    assert!(!home.file.exists() && !home.part.exists());
}

#[test]
fn a_recording_that_grows_is_followed_to_its_end() {
    let bench = Bench::new();
    let home = home();
    let sent = bytes(400_000, 2);
    bench.fake.record("r", sent[..1000].to_vec(), false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for length in [1001, 70_000, 70_000, 250_000, 400_000] {
                std::thread::sleep(Duration::from_millis(150));
                bench.fake.record("r", sent[..length].to_vec(), false);
            }
            bench.fake.record("r", sent.clone(), true);
        });
        bench.client().fetch(&run("r"), &home.file, &mut |_| assert!(!home.file.exists())).unwrap();
    });
    assert_eq!(std::fs::read(&home.file).unwrap(), sent);
}

#[test]
fn a_recording_comes_whole_over_a_way_that_is_cut_again_and_again() {
    // The long form: `ONBRICK_CUTS=100 cargo test --test it link::fetching -- --nocapture`.
    let cuts: u32 =
        std::env::var("ONBRICK_CUTS").ok().and_then(|cuts| cuts.parse().ok()).unwrap_or(8);
    let bench = Bench::new();
    let home = home();
    let sent = bytes(70_000 * cuts as usize + 300_000, 3);
    bench.fake.record("r", sent.clone(), true);
    let way = CutWay::to(bench.address(), cuts);
    let mut client = client_at(&way.address.to_string(), bench.brick_key(), &bench.pc);
    client.fetch(&run("r"), &home.file, &mut |_| {}).unwrap();
    assert!(std::fs::read(&home.file).unwrap() == sent, "not the same bytes");
    let cut = way.cuts.load(Ordering::Relaxed);
    println!("{cut} cuts, {} bytes, byte for byte right", sent.len());
    assert!(cut >= cuts / 2, "{cut} cuts");
}

#[test]
fn a_fetch_goes_on_after_the_brick_or_the_pc_was_switched_off() {
    let bench = Bench::new();
    let home = home();
    let sent = bytes(500_000, 4);
    bench.fake.record("r", sent[..200_000].to_vec(), false);
    // The brick goes away; the PC's patience ends.
    let key = bench.brick_key();
    let Bench { folder, fake, server, pc } = bench;
    let mut client = client_at(&format!("127.0.0.1:{}", server.port()), key, &pc);
    client = client.with_patience(Patience::new(8.0));
    let mut server = Some(server);
    let ended = client.fetch(&run("r"), &home.file, &mut |progress| {
        if progress.bytes == 200_000 {
            server.take();
        }
    });
    assert!(matches!(ended, Err(ClientError::NoAnswer { .. })), "{ended:?}");
    assert_eq!(std::fs::read(&home.part).unwrap(), sent[..200_000]);
    // Both are there again, and the run is over.
    let server = serve(folder.path(), &fake);
    fake.record("r", sent.clone(), true);
    let mut first = None;
    let mut client = client_at(&format!("127.0.0.1:{}", server.port()), key, &pc);
    client
        .fetch(&run("r"), &home.file, &mut |progress| first = first.or(Some(progress.bytes)))
        .unwrap();
    assert!(first >= Some(200_000), "what was there is kept: {first:?}");
    assert_eq!(std::fs::read(&home.file).unwrap(), sent);
}

#[test]
fn what_lies_there_of_another_run_is_not_mixed_into_this_one() {
    let bench = Bench::new();
    let home = home();
    let sent = bytes(300_000, 5);
    bench.fake.record("r", sent.clone(), true);
    for strange in [bytes(100_000, 6), bytes(300_000, 6), bytes(900_000, 6)] {
        std::fs::write(&home.part, strange).unwrap();
        bench.client().fetch(&run("r"), &home.file, &mut |_| {}).unwrap();
        assert!(std::fs::read(&home.file).unwrap() == sent, "not the same bytes");
        std::fs::remove_file(&home.file).unwrap();
    }
}

#[test]
fn a_link_in_the_place_of_the_part_keeps_what_it_names() {
    let bench = Bench::new();
    let home = home();
    bench.fake.record("r", bytes(1000, 5), true);
    let other = home.file.with_file_name("other");
    std::fs::write(&other, "precious").unwrap();
    for link in [std::os::unix::fs::symlink::<&Path, &Path>, std::fs::hard_link] {
        link(&other, &home.part).unwrap();
        let failed = bench.client().fetch(&run("r"), &home.file, &mut |_| {}).unwrap_err();
        assert!(matches!(failed, ClientError::File { .. }), "{failed}");
        assert_eq!(std::fs::read_to_string(&other).unwrap(), "precious");
        assert!(!home.file.exists());
        std::fs::remove_file(&home.part).unwrap();
    }
}

#[test]
fn a_slow_operation_holds_up_no_stop() {
    let bench = Bench::new();
    bench.fake.slow_ms.store(5000, Ordering::Relaxed);
    std::thread::scope(|scope| {
        scope.spawn(|| bench.client().missions().unwrap());
        until("the slow one has begun", || {
            let asked = bench.fake.asked.lock().unwrap();
            asked.iter().any(|(op, _)| op == "missions").then_some(())
        });
        let begun = std::time::Instant::now();
        bench.client().stop(None).unwrap();
        assert!(
            begun.elapsed() < LONG && begun.elapsed() < Duration::from_secs(5),
            "{:?}",
            begun.elapsed()
        );
    });
}

#[test]
fn a_recording_that_never_ends_is_taken_up_to_a_limit_and_no_further() {
    let bench = Bench::new();
    let home = home();
    let most = 3 << 20;
    let mut length = 0;
    let mut grow = || {
        length += 1 << 17;
        bench.fake.record("r", vec![7; length], false);
    };
    grow();
    let mut client = bench.client();
    client.take_at_most(most);
    // With each piece that has come it is longer by more than a piece.
    let ended = client.fetch(&run("r"), &home.file, &mut |_| grow()).unwrap_err();
    assert!(
        matches!(ended, ClientError::TooLong { bytes, most: 0x30_0000 } if bytes > most),
        "{ended}"
    );
    assert!(std::fs::metadata(&home.part).unwrap().len() <= most);
    assert!(!home.file.exists());
    // One that says so beforehand takes nothing of the disk.
    std::fs::remove_file(&home.part).unwrap();
    bench.fake.record("r", vec![7; 4 << 20], true);
    let mut client = bench.client();
    client.take_at_most(most);
    client.fetch(&run("r"), &home.file, &mut |_| {}).unwrap_err();
    assert!(!home.part.exists());
    bench.client().fetch(&run("r"), &home.file, &mut |_| {}).unwrap();
}

#[test]
fn a_file_of_the_runs_name_is_the_run_only_by_its_hash() {
    let bench = Bench::new();
    let home = home();
    let sent = bytes(300_000, 7);
    bench.fake.record("r", sent.clone(), true);
    for other in [bytes(300_000, 8), bytes(10, 8), bytes(500_000, 8), Vec::new()] {
        std::fs::write(&home.file, &other).unwrap();
        let refused = bench.client().fetch(&run("r"), &home.file, &mut |_| {}).unwrap_err();
        assert!(matches!(refused, ClientError::OtherRecording { .. }), "{refused}");
        assert!(std::fs::read(&home.file).unwrap() == other, "it stays as it was");
    }
    // The same bytes, but the run is not over: what lies there is of another one.
    bench.fake.record("r", sent.clone(), false);
    std::fs::write(&home.file, &sent).unwrap();
    let refused = bench.client().fetch(&run("r"), &home.file, &mut |_| {}).unwrap_err();
    assert!(matches!(refused, ClientError::OtherRecording { .. }), "{refused}");
    bench.fake.record("r", sent.clone(), true);
    let there = bench.client().fetch(&run("r"), &home.file, &mut |_| {}).unwrap();
    assert!(there.was_there && there.is_whole(), "{there:?}");
    assert!(!home.part.exists());
}

#[test]
fn two_that_fetch_the_same_run_at_once_never_write_one_file() {
    let bench = Bench::new();
    let sent = bytes(20 << 20, 9);
    bench.fake.record("r", sent.clone(), true);
    for round in 0..4 {
        let home = home();
        let ended: Vec<Result<bool, ClientError>> = std::thread::scope(|scope| {
            let fetch = || {
                let fetched = bench.client().fetch(&run("r"), &home.file, &mut |_| {});
                // Whatever has its final name is whole, at any time.
                assert!(
                    !home.file.exists() || std::fs::read(&home.file).unwrap() == sent,
                    "round {round}"
                );
                fetched.map(|progress| progress.was_there)
            };
            let both: Vec<_> = (0..3).map(|_| scope.spawn(fetch)).collect();
            both.into_iter().map(|one| one.join().unwrap()).collect()
        });
        assert!(std::fs::read(&home.file).unwrap() == sent, "round {round}: not the same bytes");
        let brought = ended.iter().filter(|one| matches!(one, Ok(false))).count();
        assert_eq!(brought, 1, "round {round}: {ended:?}");
        let is_clear =
            |one: &Result<bool, ClientError>| matches!(one, Ok(_) | Err(ClientError::Taken { .. }));
        assert!(ended.iter().all(is_clear), "round {round}: {ended:?}");
        assert!(!home.part.exists());
    }
}

#[test]
fn a_run_counts_as_fetched_once_its_hash_on_this_disk_was_told() {
    let bench = Bench::new();
    let home = home();
    let sent = bytes(100_000, 10);
    bench.fake.record("r", sent, true);
    bench
        .client()
        .fetch(&run("r"), &home.file, &mut |_| assert!(bench.fake.told().is_empty()))
        .unwrap();
    let hash = onbrick_hash(&std::fs::read(&home.file).unwrap());
    assert_eq!(bench.fake.told(), std::slice::from_ref(&hash));
    // A file that was spoilt on its way to the disk is nothing that the brick may forget about.
    std::fs::write(&home.file, b"spoilt").unwrap();
    bench.client().fetch(&run("r"), &home.file, &mut |_| {}).unwrap_err();
    assert!(!bench.fake.told()[1..].contains(&hash));
}

fn onbrick_hash(bytes: &[u8]) -> String {
    use sha2::Digest as _;
    sha2::Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}
