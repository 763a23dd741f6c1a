#!/usr/bin/env bash
# Makes the Debian package for a brick or a PC out of a binary and this folder. Needs dpkg-deb,
# nothing else of Debian's.
set -euo pipefail

usage() {
  cat <<'END'
Usage: brick-image/package.sh BINARY VERSION DIR [ARCHITECTURE [SHARE]]

Makes DIR/onbrick_VERSION_ARCHITECTURE.deb. ARCHITECTURE is Debian's word: for bricks armel (the
default) or armhf, of BINARY, the service, the default configuration, robot.toml and the missions;
for PCs amd64 or arm64, of a static BINARY and of SHARE, which `onbrick manual` has written.
END
}

case ${1:-} in
  -h | --help) usage && exit 0 ;;
esac
if [ $# -lt 3 ] || [ $# -gt 5 ]; then usage >&2 && exit 2; fi
binary=$1 version=$2 folder=$3 architecture=${4:-armel} share=${5:-}
image=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
[ -f "$binary" ] || {
  printf 'error: there is no %s\n  try: brick-image/build.sh, which makes it\n' "$binary" >&2 &&
    exit 1
}
case $architecture in
  amd64 | arm64)
    [ -d "$share/share" ] || {
      printf 'error: there are no pages for a PC in %s\n  try: onbrick manual FOLDER\n' \
        "${share:-the fifth argument}" >&2 && exit 1
    }
    ;;
esac
command -v dpkg-deb >/dev/null || {
  printf 'error: no dpkg-deb\n  try: the package dpkg, which every distribution has\n' >&2 && exit 1
}

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
root=$work/root
# put MODE FILE PATH
put() { install -D -m "$1" "$2" "$root/$3"; }

# What a brick has: the service, and what a person finds on it.
put_brick() {
  local unit mission script
  put 644 "$image/README.md" usr/share/doc/onbrick/README
  put 755 "$image/package/check" usr/lib/onbrick/check
  for unit in onbrick onbrick-menu; do
    put 644 "$image/package/$unit.service" "lib/systemd/system/$unit.service"
  done
  put 644 "$image/onbrick.toml" etc/onbrick/onbrick.toml
  put 644 "$image/package/onbrick.avahi" etc/avahi/services/onbrick.service
  put 644 "$image/robot.toml" usr/share/onbrick/robot.toml
  for mission in "$image"/missions/*.toml; do
    put 644 "$mission" "usr/share/onbrick/missions/$(basename "$mission")"
  done
  put 755 "$image/package/onbrick-menu" usr/share/onbrick/onbrick-menu
  (cd "$root" && md5sum usr/bin/onbrick) >"$root/usr/lib/onbrick/md5"
  for script in postinst prerm postrm; do put 755 "$image/package/$script" "DEBIAN/$script"; done
  printf '%s\n' /etc/onbrick/onbrick.toml /etc/avahi/services/onbrick.service \
    >"$root/DEBIAN/conffiles"
}

# What a PC has: the manual's pages and the completions, where Debian looks for them.
put_pc() {
  local page
  put 644 "$image/../README.md" usr/share/doc/onbrick/README
  put 644 "$image/../src/USING.md" usr/share/doc/onbrick/USING
  for page in "$share"/share/man/man1/*; do
    put 644 "$page" "usr/share/man/man1/$(basename "$page")"
  done
  gzip -9n "$root"/usr/share/man/man1/*
  put 644 "$share/share/bash-completion/completions/onbrick" \
    usr/share/bash-completion/completions/onbrick
  put 644 "$share/share/zsh/site-functions/_onbrick" usr/share/zsh/vendor-completions/_onbrick
  put 644 "$share/share/fish/vendor_completions.d/onbrick.fish" \
    usr/share/fish/vendor_completions.d/onbrick.fish
  mkdir "$root/DEBIAN"
}

put 755 "$binary" usr/bin/onbrick
put 644 "$image/../LICENSE" usr/share/doc/onbrick/copyright
put 644 "$image/../src/CHANGELOG.md" usr/share/doc/onbrick/changelog
gzip -9n "$root/usr/share/doc/onbrick/changelog"
case $architecture in
  amd64 | arm64) put_pc && control='control-pc' ;;
  *) put_brick && control=control ;;
esac
(cd "$root" && find . -path ./DEBIAN -prune -o -type f -printf '%P\0' | sort -z | xargs -0 md5sum) \
  >"$root/DEBIAN/md5sums"
size_kb=$(du -s -k --exclude=DEBIAN "$root" | cut -f1)
sed -e "s/@VERSION@/$version/" -e "s/@ARCHITECTURE@/$architecture/" \
  -e "s/@SIZE@/$size_kb/" "$image/package/$control" \
  >"$root/DEBIAN/control"

# The same input makes the same file: one time for everything, and sorted names (dpkg-deb sorts).
export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-1577836800}
find "$root" -exec touch -h -d "@$SOURCE_DATE_EPOCH" {} +
mkdir -p "$folder"
# xz, because Debian 9's dpkg knows no zstd.
dpkg-deb --root-owner-group -Zxz --build "$root" "$folder/onbrick_${version}_$architecture.deb"
