#!/usr/bin/env bash
# Builds what the emulated brick has beside the brick's own file, and prints its folder:
# onbrick-sim, which is onbrick with the simulated brick, and brick-figures, which measures: one
# file under two names.
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

if [ $# -gt 0 ]; then
  echo "Usage: tools.sh    builds the emulated brick's further programs, and prints their folder"
  [ "$1" = --help ] && exit 0 || exit 2
fi
needs arm-linux-gnueabi-strip=binutils-arm-linux-gnueabi
cd "$checkout"
# With the brick's own features, so that little is built twice.
arm_cargo build --release --no-default-features --features link,sim --example brick-figures >&2
built=${CARGO_TARGET_DIR:-$checkout/target}/armv5te-unknown-linux-gnueabi/release
folder=$checkout/target/emulator
mkdir -p "$folder"
# In one step, because another script may be copying it.
arm-linux-gnueabi-strip -o "$folder/onbrick-sim.$$" "$built/examples/brick-figures"
mv "$folder/onbrick-sim.$$" "$folder/onbrick-sim"
ln -sf onbrick-sim "$folder/brick-figures"
echo "$folder"
