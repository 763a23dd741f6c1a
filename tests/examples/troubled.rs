//! onbrick itself, but SIGUSR1 makes its main thread spin for ever: in the process that drives, the one that ticks. For the tests of what
//! stops the motors then.

use std::process::ExitCode;

#[allow(
    unsafe_code,
    reason = "only a handler that never returns gets hold of a thread of a program that is not ours to change"
)]
fn main() -> ExitCode {
    // SAFETY: the handler calls nothing: it only spins.
    let registered = unsafe { signal_hook::low_level::register(signal_hook::consts::SIGUSR1, spin) };
    if registered.is_err() {
        return ExitCode::FAILURE;
    }
    onbrick::cli::main(std::env::args_os())
}

fn spin() {
    loop {
        std::hint::spin_loop();
    }
}
