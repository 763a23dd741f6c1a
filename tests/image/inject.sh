#!/usr/bin/env bash
# inject.sh on an image with the layout of ev3dev's: a FAT partition with a kernel and an ext4
# partition with a Debian armel root. With --keep FILE the image that came out is left there, for
# the emulated brick to boot; with --key KEY after it, that key is in it.
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
needs sfdisk=fdisk mkfs.vfat=dosfstools mcopy=mtools debugfs=e2fsprogs

keep=''
[ "${1:-}" != --keep ] || keep=$2
key='rq:rM>}U?@Lns47E1%kR.o@n%FcmmsL/@{H8]yf7'
[ "${3:-}" != --key ] || key=$4
inject() { "$checkout/brick-image/inject.sh" "$@" --deb "$deb" >"$work/said" 2>&1; }

make_image() {
  local image=$1 megabytes=640
  truncate -s ${megabytes}M "$image"
  printf '%s,%s,c\n%s,,83\n' $fat_sector $((linux_sector - fat_sector)) $linux_sector |
    sfdisk -q "$image"
  truncate -s 48M "$work/boot"
  mkfs.vfat -n EV3DEV_BOOT "$work/boot" >/dev/null
  echo kernel >"$work/uImage"
  mcopy -i "$work/boot" "$work/uImage" ::uImage
  dd if="$work/boot" of="$image" bs=512 seek=$fat_sector conv=notrunc status=none
  mke2fs -q -t ext4 -d "$root" -E "$linux" "$image" $((megabytes * 1024 - linux_sector / 2))k
}

in_image() { debugfs -R "$1" "$2?$linux" 2>/dev/null; }
# Everything in an image's root, with its mode, owner and target, and the content of plain files;
# not what inject.sh is there to change.
contents() {
  local folder ours=(! -path './var/cache/onbrick*' ! -path ./etc/hostname ! -path ./etc/hosts
    ! -path './var/lib/connman*' ! -name onbrick-install.service)
  folder=$(mktemp -d "$work/contents.XXXX")
  in_image "rdump / $folder" "$1"
  (cd "$folder" && find . "${ours[@]}" -printf '%p %y %m %U %G %l\n' | sort &&
    find . -type f "${ours[@]}" -print0 | sort -z | xargs -0 sha256sum)
  rm -rf "$folder"
}

unpack_root
image=$work/ev3dev.img
make_image "$image"
before=$(sha256sum <"$image")

head -c 5000000 "$image" >"$work/short.img"
check "a file that is cut is refused" not inject "$work/short.img"
check "with a way out" says "$work/said" "try: "
cp --sparse=always "$image" "$work/other.img"
debugfs -w -R 'rm /etc/ev3dev-release' "$work/other.img?$linux" 2>/dev/null
check "another system's image is refused" not inject "$work/other.img"
check "and named" says "$work/said" "is no ev3dev image"
check "a name that no network takes is refused" not inject "$image" --name "Red Brick"
check "so is a key that is none" not inject "$image" --key 12345
check "so is a password that is too short" not inject "$image" --out "$work/new.img" \
  --wifi "Room 12" <<<short
check "and no image is left of that" [ ! -e "$work/new.img" ]
check "nothing was changed by any of that" [ "$(sha256sum <"$image")" = "$before" ]

# Where the checkout lies is the person's own affair; the password has no end of line, as from a
# password manager.
mkdir "$work/a folder"
cp "$deb" "$work/a folder/onbrick.deb"
deb="$work/a folder/onbrick.deb"
printf 'secret\\of room 12 ' | inject "$image" --out "$work/red.img" --name red --wifi "Room 12" \
  --key "key          $key"$'\n'"fingerprint  0123-4567-89ab-cdef" || {
  cat "$work/said" && exit 1
}
check "the original is as it was" [ "$(sha256sum <"$image")" = "$before" ]
check "the password is nowhere in what is said" not says "$work/said" "secret"
check "the package is in it" [ \
  "$(in_image 'cat /var/cache/onbrick/onbrick.deb' "$work/red.img" | sha256sum)" = \
  "$(sha256sum <"$deb")" ]
wanted=/etc/systemd/system/multi-user.target.wants/onbrick-install.service
check "it will be installed at the first start" [ -n "$(in_image "stat $wanted" "$work/red.img")" ]
check "the name" [ "$(in_image 'cat /etc/hostname' "$work/red.img")" = red ]
check "the name among the hosts" [ \
  "$(in_image 'cat /etc/hosts' "$work/red.img" | grep -c $'^127.0.1.1\tred$')" = 1 ]
in_image 'cat /var/lib/connman/onbrick.config' "$work/red.img" >"$work/wifi"
check "the network" says "$work/wifi" "Name=Room 12"
check "its password, as GLib reads it" grep -qFx 'Passphrase=secret\\of room 12\s' "$work/wifi"
in_image 'stat /var/lib/connman/onbrick.config' "$work/red.img" >"$work/stat"
check "which only root can read" grep -q 'Mode:  0600 ' "$work/stat"
check "whose it is" grep -q 'User:     0   Group:     0' "$work/stat"
check "the radio is on" [ \
  "$(in_image 'cat /var/lib/connman/settings' "$work/red.img" | grep -A1 -F '[WiFi]' | tail -n 1)" \
  = Enable=true ]
check "the PC's key" [ "$(in_image 'cat /var/cache/onbrick/keys' "$work/red.img")" = "$key" ]
contents "$image" >"$work/original"
contents "$work/red.img" >"$work/injected"
check "the image has files" [ "$(wc -l <"$work/original")" -gt 1000 ]
check "nothing else was touched" diff "$work/original" "$work/injected"
check "the boot partition is bit for bit the same" cmp -n $((98304 * 512)) -i $((8192 * 512)) \
  "$image" "$work/red.img"
check "the file system is in order" e2fsck -fn "$work/red.img?$linux"
inject "$work/red.img" --name red --wifi "Room 13" </dev/null
check "a second time changes what it says" [ \
  "$(in_image 'cat /var/lib/connman/onbrick.config' "$work/red.img" | grep -c '^Name=Room 13$')" \
  = 1 ]
[ -z "$keep" ] || cp --sparse=always "$work/red.img" "$keep"
finish
