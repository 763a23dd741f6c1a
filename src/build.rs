//! The build script: libzmq with CURVE, for the feature `link`.
//!
//! The crate `zmq` brings a libzmq without CURVE, and no option of it switches CURVE on. So this
//! script builds libzmq against the libsodium of `libsodium-sys-stable`, and a `links` override in
//! Cargo's configuration (`.cargo/config.toml`, `cross.toml`) keeps zmq-sys from building its own.
//! Without that override - in the packaged crate, or in another package that uses it - both are
//! built, and `src/link/curve.rs` makes sure that this one is linked.
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
    // What libsodium-sys-stable says of itself reaches the build scripts of the packages that
    // depend on it.
    let sodium = zeromq_src::LibLocation::new(
        std::env::var("DEP_SODIUM_LIB")?,
        std::env::var("DEP_SODIUM_INCLUDE")?,
    );
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
        ];
        for argument in group {
            let argument = if argument.starts_with("-l") {
                argument.to_owned()
            } else {
                format!("-Wl,{argument}")
            };
            println!("cargo:rustc-link-arg={argument}");
        }
    }
    Ok(())
}
