#!/usr/bin/env bash
# Builds what the emulated brick has beside the brick's own file, and prints its folder: onbrick-sim, which is onbrick with the simulated
# brick, and brick-figures, which measures.
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

if [ $# -gt 0 ]; then
  echo "Usage: tools.sh    builds what the emulated brick has beside the brick's own file, and prints its folder"
  [ "$1" = --help ] && exit 0 || exit 2
fi
needs arm-linux-gnueabi-strip=binutils-arm-linux-gnueabi
cd "$checkout"
# build.sh makes the first for its own checks; the other has the same features, so that little is built anew.
with_sim=target/brick-check/onbrick-sim
[ -x $with_sim ] || fail "there is no $with_sim" "brick-image/build.sh, which makes it"
arm_cargo build --release --no-default-features --features link,sim --example brick-figures >&2
folder=$checkout/target/emulator
mkdir -p "$folder"
cp $with_sim "$folder/onbrick-sim"
arm-linux-gnueabi-strip -o "$folder/brick-figures" target/armv5te-unknown-linux-gnueabi/release/examples/brick-figures
echo "$folder"
