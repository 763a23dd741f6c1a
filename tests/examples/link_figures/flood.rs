//! Strangers at a brick's door: whole CURVE handshakes with keys that it does not know, and half
//! ones.

use std::io::Write as _;
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

/// How many handshake at the same time.
const STRANGERS: usize = 4;

/// A stranger who has got nowhere by then tries again.
const PATIENCE_MS: i64 = 40;

/// The first bytes of ZMTP 3 (rfc.zeromq.org/spec/23): a peer that gets these waits for more.
const GREETING: [u8; 12] = [0xff, 0, 0, 0, 0, 0, 0, 0, 1, 0x7f, 3, 0];

/// Floods a door; `key` is the brick's own, which is no secret.
pub(crate) fn flood(
    address: &str,
    key: &str,
    seconds: f64,
) -> Result<(), Box<dyn std::error::Error>> {
    let until = Instant::now() + Duration::from_secs_f64(seconds);
    let (door, key) = (address.parse::<SocketAddr>()?, zmq::z85_decode(key)?);
    let (whole, half) = (AtomicU32::new(0), AtomicU32::new(0));
    std::thread::scope(|scope| {
        for _ in 0..STRANGERS {
            scope.spawn(|| {
                let context = zmq::Context::new();
                while Instant::now() < until && handshake(&context, address, &key).is_ok() {
                    whole.fetch_add(1, Ordering::Relaxed);
                }
            });
        }
        while Instant::now() < until {
            let patience = Duration::from_millis(PATIENCE_MS.unsigned_abs());
            if let Ok(mut stream) = TcpStream::connect_timeout(&door, patience) {
                half.fetch_add(u32::from(stream.write_all(&GREETING).is_ok()), Ordering::Relaxed);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    });
    let (whole, half) = (whole.into_inner(), half.into_inner());
    println!("{}", serde_json::json!({ "handshakes": whole, "half": half }));
    Ok(())
}

fn handshake(context: &zmq::Context, address: &str, key: &[u8]) -> zmq::Result<()> {
    let stranger = zmq::CurveKeyPair::new()?;
    let socket = context.socket(zmq::DEALER)?;
    socket.set_linger(0)?;
    socket.set_immediate(true)?;
    socket.set_curve_serverkey(key)?;
    socket.set_curve_publickey(&stranger.public_key)?;
    socket.set_curve_secretkey(&stranger.secret_key)?;
    socket.connect(&format!("tcp://{address}"))?;
    // No key is let in, so this only waits out the patience.
    socket.poll(zmq::POLLOUT, PATIENCE_MS).map(drop)
}
