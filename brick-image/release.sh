#!/usr/bin/env bash
# Makes target/dist: what people install, built of the crate as it is packaged.
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=emulator/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/emulator/common.sh"

usage() {
  cat <<'END'
Usage: brick-image/release.sh [PROCESSOR…]

Makes what people install, and puts it into target/dist:

  onbrick-VERSION.crate                    the crate, as `cargo publish` would send it
  onbrick-VERSION-linux-x86_64.tar.xz      for PCs: one static program, manual and completions
  onbrick_VERSION_amd64.deb                the same as a Debian package
  onbrick-VERSION-linux-aarch64.tar.xz     for PCs with ARM processors
  onbrick_VERSION_arm64.deb                the same as a package
  onbrick_VERSION_armel.deb                for the EV3 (build.sh)
  onbrick_VERSION_armhf.deb                for a Raspberry Pi 2 and later or a BeagleBone
  SHA256SUMS                               the checksums of all that is there

The programs for PCs are built of the unpacked crate, where no configuration of this repository is
found. PROCESSOR is x86_64, aarch64, armv5te or armv7: only these. Installs what is missing, as
build.sh does. ONBRICK_OPT_LEVEL is the level at which programs for PCs are optimized: 3 by default,
and lower where they are tested and not published, because that builds faster. Exit codes: 0 done;
1 something could not be built or installed; 3 it is not fit.
END
}

built=${CARGO_TARGET_DIR:-$checkout/target}
dist=$checkout/target/dist
# The crate; bytes.
largest=2000000

say() { printf 'release: %s\n' "$*" >&2; }

unfit() {
  printf 'error: not fit for a release: %s\n' "$1" >&2
  exit 3
}

# What changed since the last commit is refused: it would not be what the version says.
package_crate() {
  local crate=$dist/onbrick-$version.crate size
  rm -f "$built/package/onbrick-$version.crate"
  { cargo publish --dry-run --no-verify && cargo package --no-verify; } ||
    fail "the crate could not be packaged"
  cp "$built/package/onbrick-$version.crate" "$dist"
  size=$(stat -c %s "$crate")
  [ "$size" -le "$largest" ] || unfit "a crate of $size bytes, more than $largest"
  # With today's times: those in a crate are always the same, and cargo would take the program that
  # it built of the last one for this one's.
  tar xzmf "$crate" -C "$work"
  say "the crate has $size bytes"
}

# For a PC with the chosen processor: the program, and beside it what goes with it.
build_pc() {
  local name=onbrick-$version-linux-$1 program
  install_compiler
  needs xz=xz-utils dpkg-deb=dpkg
  install_rust
  # Optimized as `cargo install` does it, and not as a whole, which takes minutes.
  (cd "$work" && CARGO_TARGET_DIR=$built cross_cargo install --locked --no-track \
    --config "profile.release.opt-level=${ONBRICK_OPT_LEVEL:-3}" \
    --config profile.release.lto=false --config profile.release.codegen-units=16 \
    --path "onbrick-$version" --root "$work/installed-$1") ||
    fail "the program for $1 could not be built"
  program=$work/$name/bin/onbrick
  mkdir -p "$work/$name/bin"
  "$gnu-strip" -o "$program" "$work/installed-$1/bin/onbrick"
  ! "$gnu-readelf" -lW "$program" | grep -q INTERP || unfit "the program for $1 wants a loader"
  ${emulated[@]+"${emulated[@]}"} "$program" manual "$work/$name" >/dev/null ||
    unfit "the program for $1 does not start"
  "$here/../package.sh" "$program" "$version" "$dist" "$architecture" "$work/$name"
  install -D -m 644 -t "$work/$name/share/doc/onbrick" README.md LICENSE src/{CHANGELOG,USING}.md
  # The same input makes the same file.
  tar cJf "$dist/$name.tar.xz" -C "$work" --sort=name --mtime=@1577836800 --owner=0 --group=0 \
    --numeric-owner "$name"
  say "$name: a program of $(stat -c %s "$program") bytes"
}

case ${1:-} in
  -h | --help) usage && exit 0 ;;
  -*)
    printf 'error: there is no option %s\n\n' "$1" >&2
    usage >&2 && exit 2
    ;;
esac
[ $# -gt 0 ] || set -- x86_64 aarch64 armv5te armv7
cd "$checkout"
version=$(version)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$dist"
package_crate
for processor; do
  choose_processor "$processor"
  case $processor in
    x86_64 | aarch64) build_pc "$processor" ;;
    *)
      pc=()
      program=$work/onbrick-$version-linux-$(uname -m)/bin/onbrick
      [ ! -e "$program" ] || pc=(--pc "$program")
      brick-image/build.sh --for "$processor" ${pc[@]+"${pc[@]}"}
      cp "target/brick/onbrick_${version}_$architecture.deb" "$dist"
      ;;
  esac
done
make_checksums "$dist"
say "done"
ls -l "$dist" >&2
