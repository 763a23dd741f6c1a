//! The build script: libzmq with CURVE, for the feature `link`.
//!
//! The crate `zmq` brings a libzmq that has no CURVE, and no option of it switches that on. So libzmq is built here, against the libsodium that
//! `libsodium-sys-stable` has built, and a `links` override in Cargo's configuration (`.cargo/config.toml`, `cross.toml`) keeps
//! zmq-sys from building its own. Where there is no such override - in a program of somebody else's that uses this crate - both are built, and
//! `src/link/curve.rs` sees to it that this one is linked.
//!
//! # Not here
//!
//! Without the feature nothing is built, and no C++ compiler is needed.

use std::env::VarError;

fn main() -> Result<(), VarError> {
    println!("cargo:rerun-if-changed=src/build.rs");
    #[cfg(feature = "link")]
    libzmq()?;
    Ok(())
}

#[cfg(feature = "link")]
fn libzmq() -> Result<(), VarError> {
    let features = std::env::var("CARGO_CFG_TARGET_FEATURE").unwrap_or_default();
    let is_static = features.split(',').any(|feature| feature == "crt-static");
    if is_static {
        println!("cargo:rerun-if-changed={SMALL_HEADERS}");
        put_before_the_compilers_headers(SMALL_HEADERS);
    }
    // What libsodium-sys-stable says of itself reaches the build scripts of the packages that depend on it.
    let sodium =
        zeromq_src::LibLocation::new(std::env::var("DEP_SODIUM_LIB")?, std::env::var("DEP_SODIUM_INCLUDE")?);
    zeromq_src::Build::new().with_libsodium(Some(sodium)).build();

    if is_static {
        // GNU ld reads archives once and in order, and these need each other.
        let group = [
            "-Bstatic",
            "--start-group",
            "-lzmq",
            "-lsodium",
            "-lstdc++",
            "-lgcc",
            "-lgcc_eh",
            "-lc",
            "--end-group",
            // What ends the program at an exception that nothing catches: libstdc++'s own says its type first, which takes 45 kB. libzmq throws
            // none but for memory that is not there.
            "--defsym=_ZN9__gnu_cxx27__verbose_terminate_handlerEv=abort",
        ];
        for argument in group {
            let argument =
                if argument.starts_with("-l") { argument.to_owned() } else { format!("-Wl,{argument}") };
            println!("cargo:rustc-link-arg={argument}");
        }
    }
    Ok(())
}

/// Headers with what libzmq uses of the standard ones; each says why.
#[cfg(feature = "link")]
const SMALL_HEADERS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/src/link/libzmq");

/// The crate that compiles libzmq has no option for that; GCC and Clang take it from here.
#[cfg(feature = "link")]
#[allow(unsafe_code, reason = "the only thread there is sets a variable for the compilers that it starts")]
fn put_before_the_compilers_headers(folder: &str) {
    // SAFETY: this program has started no thread.
    unsafe { std::env::set_var("CPLUS_INCLUDE_PATH", folder) };
}
