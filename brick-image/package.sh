#!/usr/bin/env bash
# Makes the Debian package for the brick out of a binary and this folder. Needs dpkg-deb, nothing
# else of Debian's.
set -euo pipefail

usage() {
  cat <<'END'
Usage: brick-image/package.sh BINARY VERSION DIR [ARCHITECTURE]

Makes DIR/onbrick_VERSION_ARCHITECTURE.deb of the brick's BINARY, the service, the default
configuration, robot.toml and the missions. ARCHITECTURE is Debian's word: armel (the default) or
armhf.
END
}

case ${1:-} in
  -h | --help) usage && exit 0 ;;
esac
if [ $# -lt 3 ] || [ $# -gt 4 ]; then usage >&2 && exit 2; fi
binary=$1 version=$2 folder=$3 architecture=${4:-armel}
image=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
[ -f "$binary" ] || {
  printf 'error: there is no %s\n  try: brick-image/build.sh, which makes it\n' "$binary" >&2 &&
    exit 1
}
command -v dpkg-deb >/dev/null || {
  printf 'error: no dpkg-deb\n  try: the package dpkg, which every distribution has\n' >&2 && exit 1
}

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
root=$work/root
# put MODE FILE PATH
put() { install -D -m "$1" "$2" "$root/$3"; }

put 755 "$binary" usr/bin/onbrick
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
put 644 "$image/../README.md" usr/share/doc/onbrick/README
put 644 "$image/../LICENSE" usr/share/doc/onbrick/copyright
(cd "$root" && md5sum usr/bin/onbrick) >"$root/usr/lib/onbrick/md5"

for script in postinst prerm postrm; do put 755 "$image/package/$script" "DEBIAN/$script"; done
printf '%s\n' /etc/onbrick/onbrick.toml /etc/avahi/services/onbrick.service \
  >"$root/DEBIAN/conffiles"
(cd "$root" && find . -path ./DEBIAN -prune -o -type f -printf '%P\0' | sort -z | xargs -0 md5sum) \
  >"$root/DEBIAN/md5sums"
size_kb=$(du -s -k --exclude=DEBIAN "$root" | cut -f1)
sed -e "s/@VERSION@/$version/" -e "s/@ARCHITECTURE@/$architecture/" \
  -e "s/@SIZE@/$size_kb/" "$image/package/control" \
  >"$root/DEBIAN/control"

# The same input makes the same file: one time for everything, and sorted names (dpkg-deb sorts).
export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-1577836800}
find "$root" -exec touch -h -d "@$SOURCE_DATE_EPOCH" {} +
mkdir -p "$folder"
# xz, because Debian 9's dpkg knows no zstd.
dpkg-deb --root-owner-group -Zxz --build "$root" "$folder/onbrick_${version}_$architecture.deb"
