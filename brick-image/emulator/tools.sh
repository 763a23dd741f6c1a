#!/usr/bin/env bash
# Builds what an emulated processor has beside the brick's own file, and prints its folder:
# onbrick-sim, which is onbrick with the simulated brick, and brick-figures, which measures: one
# file under two names. For another processor than the EV3's the folder ends in its name.
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

if [ $# -gt 1 ] || [ "${1:-}" = --help ]; then
  echo "Usage: tools.sh [PROCESSOR]    builds an emulated brick's programs, and prints their folder"
  [ "$1" = --help ] && exit 0 || exit 2
fi
choose_processor "${1:-armv5te}"
needs "$gnu-strip=binutils-$gnu"
cd "$checkout"
# With the brick's own features, so that little is built twice.
cross_cargo build --release --no-default-features --features link,sim --example brick-figures >&2
built=${CARGO_TARGET_DIR:-$checkout/target}/$target/release
folder=$checkout/target/emulator$suffix
mkdir -p "$folder"
# In one step, because another script may be copying it.
"$gnu-strip" -o "$folder/onbrick-sim.$$" "$built/examples/brick-figures"
mv "$folder/onbrick-sim.$$" "$folder/onbrick-sim"
ln -sf onbrick-sim "$folder/brick-figures"
echo "$folder"
