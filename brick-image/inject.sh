#!/usr/bin/env bash
# Puts onbrick into an ev3dev SD card image, so that the card can be flashed and the brick is ready
# at its first power-on.
set -euo pipefail

usage() {
  cat <<'END'
Usage: brick-image/inject.sh IMAGE [OPTIONS]

Puts the package into IMAGE, an ev3dev SD card image for an EV3 or a Raspberry Pi 2 and later
(unpacked: a file that ends in .img). At its first start the brick installs it by itself. Needs no
root. A dozen bricks are twelve commands:
  brick-image/inject.sh ev3dev.img --out red.img --name red --wifi "Room 12" \
    --key "$(onbrick key show)"

  --out NEW.img     leave IMAGE alone and make this one
  --name NAME       the brick's name on the network; without it all are called ev3dev
  --wifi NAME       join this wireless network; the password is asked for, or the first line of
                    standard input
  --key KEY         let this PC in: what `onbrick key show` prints, or a file with that in it;
                    can be repeated
  --deb FILE        the package (default: the one in target/brick for the image's board)
  -h, --help        this
END
}

fail() {
  printf 'error: %s\n' "$1" >&2
  [ $# -lt 2 ] || printf '  try: %s\n' "$2" >&2
  exit 1
}
say() { printf 'inject: %s\n' "$*"; }
# The value of an option: value OPTION [VALUE].
value() {
  [ -n "${2-}" ] && return
  printf 'error: %s needs a value\n\n' "$1" >&2
  usage >&2 && exit 2
}

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
image='' out='' name='' wifi='' password='' deb='' keys=()
while [ $# -gt 0 ]; do
  case $1 in
    --out) value "$@" && out=$2 && shift ;;
    --name) value "$@" && name=$2 && shift ;;
    --wifi) value "$@" && wifi=$2 && shift ;;
    --key) value "$@" && keys+=("$2") && shift ;;
    --deb) value "$@" && deb=$2 && shift ;;
    -h | --help) usage && exit 0 ;;
    -*)
      printf 'error: there is no option %s\n\n' "$1" >&2
      usage >&2 && exit 2
      ;;
    *)
      if [ -n "$image" ]; then usage >&2 && exit 2; fi
      image=$1
      ;;
  esac
  shift
done
if [ -z "$image" ]; then usage >&2 && exit 2; fi

# Everything is checked before anything is written.
check_tools() {
  # An ordinary user's PATH does not lead to sfdisk and debugfs.
  PATH=$PATH:/usr/sbin:/sbin
  local missing=()
  command -v sfdisk >/dev/null || missing+=(fdisk)
  command -v mdir >/dev/null || missing+=(mtools)
  command -v debugfs >/dev/null || missing+=(e2fsprogs)
  [ ${#missing[@]} = 0 ] || fail "this needs ${missing[*]}" "apt-get install ${missing[*]}"
}

# As host names are (RFC 1123), so that it can be looked up as NAME.local.
check_name() {
  [ -z "$name" ] || [[ $name =~ ^[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?$ ]] ||
    fail "$name cannot be a brick's name" \
      "small letters a to z, digits, and - in between; at most 63"
}

# A key is 40 signs of Z85, alone or as `onbrick key show` prints it.
read_keys() {
  local place=0 key
  for key in ${keys[@]+"${keys[@]}"}; do
    if [ -f "$key" ]; then key=$(<"$key"); fi
    key=$(tr -s ' ' '\n' <<<"$key" |
      grep -xE '[]0-9a-zA-Z.:+=^!/*?&<>()[{}@%$#-]{40}' | head -n 1) ||
      fail "this is no key: ${keys[$place]}" "a key has 40 signs; onbrick key show prints this PC's"
    keys[place]=$key
    place=$((place + 1))
  done
}

# The password comes from the person or from standard input, and is looked at before anything is
# written.
read_password() {
  [ -n "$wifi" ] || return 0
  if [ -t 0 ]; then
    IFS= read -rsp "password of $wifi: " password && echo
  else
    IFS= read -r password || true
  fi
  [ ${#password} -ge 8 ] || [ -z "$password" ] ||
    fail "a wireless password has at least 8 signs" "nothing for an open network"
}

# Of the architecture that the image's dpkg has.
find_deb() {
  local architecture
  architecture=$(get /var/lib/dpkg/status |
    sed -n '/^Package: dpkg$/,/^$/s/^Architecture: //p' | head -n 1)
  case $architecture in
    armel | armhf) ;;
    *) fail "$image is for a processor that onbrick is not built for: ${architecture:-unknown}" \
      "an ev3dev image for the EV3, or for a Raspberry Pi 2 or later" ;;
  esac
  local built_by=brick-image/build.sh
  [ "$architecture" = armel ] || built_by+=' --for armv7'
  [ -n "$deb" ] ||
    deb=$(find "$here/../target/brick" -name "onbrick_*_$architecture.deb" 2>/dev/null |
      sort -V | tail -n 1) || true
  if [ -z "$deb" ] || [ ! -f "$deb" ]; then
    fail "there is no package ${deb:-for $architecture in target/brick}" "$built_by, which makes it"
  fi
  case $(basename "$deb") in
    "onbrick_"*"_$architecture.deb") ;;
    onbrick_*_arm??.deb) fail "$deb is not for the board of $image: it takes $architecture" \
      "$built_by" ;;
  esac
  [ "$(head -c 7 "$deb")" = '!<arch>' ] || fail "$deb is no Debian package" \
    "brick-image/build.sh makes one"
}

# partition TYPE…: where the first partition of such a type begins, in bytes.
partition() {
  local type
  for type; do
    sfdisk -d "$image" 2>/dev/null |
      sed -n "s/.*start= *\\([0-9]*\\), size= *[0-9]*, type=0*$type\\(,.*\\)\\{0,1\\}\$/\\1/p" |
      head -n 1 | grep . && return
  done
}

# An ev3dev image: a FAT partition with the kernel on it, and an ext4 partition with ev3dev's own
# file in it.
check_image() {
  local fat_sector root_sector
  [ -f "$image" ] || fail "there is no file $image" \
    "unpack the image that ev3dev.org offers; it ends in .img"
  [ -w "$image" ] || [ -n "$out" ] || fail "$image cannot be written to" "--out NEW.img"
  fat_sector=$(partition c b e 6) || fat_sector=''
  root_sector=$(partition 83) || root_sector=''
  if [ -z "$fat_sector" ] || [ -z "$root_sector" ]; then
    fail "$image is no SD card image with a FAT and a Linux partition" "an ev3dev image, unpacked"
  fi
  boot=$image@@$((fat_sector * 512))
  offset=$((root_sector * 512))
  local kernel kernels=(uImage kernel7.img)
  for kernel in "${kernels[@]}" ''; do
    ! MTOOLS_SKIP_CHECK=1 mdir -b -i "$boot" "::$kernel" >/dev/null 2>&1 || break
  done
  [ -n "$kernel" ] ||
    fail "there is no kernel for an EV3 (uImage) or a Raspberry Pi 2 (kernel7.img) in $image" \
      "an image for one of them"
  local release
  release=$(debugfs -R 'cat /etc/ev3dev-release' "$image?offset=$offset" 2>/dev/null | head -n 1)
  [ -n "$release" ] || fail "$image is no ev3dev image: it has no /etc/ev3dev-release" \
    "an ev3dev image, unpacked"
  e2fsck -fn "$image?offset=$offset" >/dev/null 2>&1 ||
    fail "the Linux partition of $image is not in order" \
      "unpack the image again; or, if a brick ran from it, e2fsck it"
  say "$image is $release"
}

# dpkg unpacks the package beside the old one, so that three times its size is enough.
check_room() {
  local free
  free=$(dumpe2fs -h "$image?offset=$offset" 2>/dev/null |
    awk -F: '/^Free blocks/ { n = $2 } /^Block size/ { size = $2 } END { print n * size }')
  [ "$free" -gt $((3 * $(stat -c %s "$deb") + (16 << 20))) ] ||
    fail "there is no room in $image" "an image that nothing else was put into"
}

# in_root COMMAND…: one of debugfs's commands on the root partition. It ends with 0 whatever
# happens, so what it says is looked at.
in_root() {
  local said
  said=$(debugfs -w -R "$*" "$image?offset=$offset" 2>&1 | sed '1{/^debugfs [0-9]/d}')
  case $said in
    '' | 'Allocated inode: '*) ;;
    *) fail "debugfs, $*: $said" "unpack the image and try again" ;;
  esac
}

exists() { debugfs -R "stat $1" "$image?offset=$offset" 2>/dev/null | grep -q '^Inode: '; }

make_folder() {
  local path='' part
  for part in ${1//\// }; do
    path=$path/$part
    exists "$path" || in_root "mkdir $path"
  done
}

# put FILE PATH MODE: root's; an older one is taken away first.
put() {
  make_folder "$(dirname "$2")"
  ! exists "$2" || in_root "rm $2"
  in_root "write \"$1\" $2"
  in_root "set_inode_field $2 mode 0100$3"
  in_root "set_inode_field $2 uid 0"
  in_root "set_inode_field $2 gid 0"
}

get() { debugfs -R "cat $1" "$image?offset=$offset" 2>/dev/null; }

put_package() {
  put "$deb" /var/cache/onbrick/onbrick.deb 644
  put "$here/package/install-first" /var/cache/onbrick/install-first 755
  put "$here/package/onbrick-install.service" /etc/systemd/system/onbrick-install.service 644
  make_folder /etc/systemd/system/multi-user.target.wants
  local unit=onbrick-install.service units=/etc/systemd/system
  exists $units/multi-user.target.wants/$unit ||
    in_root "symlink $units/multi-user.target.wants/$unit $units/$unit"
}

put_name() {
  echo "$name" >"$work/hostname"
  put "$work/hostname" /etc/hostname 644
  get /etc/hosts | sed "s/^127\\.0\\.1\\.1.*/127.0.1.1\\t$name/" >"$work/hosts"
  grep -q '^127\.0\.1\.1' "$work/hosts" || printf '127.0.1.1\t%s\n' "$name" >>"$work/hosts"
  put "$work/hosts" /etc/hosts 644
}

# in_key_file TEXT: as connman's files have it, which GLib reads: a backslash begins an escape, and
# spaces at either end would be lost.
in_key_file() { sed -e 's/\\/\\\\/g' -e 's/^ /\\s/' -e 's/ $/\\s/' <<<"$1"; }

# connman reads a network from a file of its own, and its settings say whether the radio is on.
put_wifi() {
  printf '[service_onbrick]\nType=wifi\nName=%s\n' "$(in_key_file "$wifi")" >"$work/wifi"
  [ -z "$password" ] || printf 'Passphrase=%s\n' "$(in_key_file "$password")" >>"$work/wifi"
  put "$work/wifi" /var/lib/connman/onbrick.config 600
  get /var/lib/connman/settings >"$work/settings" || true
  if grep -qx '\[WiFi\]' "$work/settings"; then
    sed -i -e '/^\[WiFi\]$/,/^\[/ { /^Enable=/d }' -e 's/^\[WiFi\]$/&\nEnable=true/' \
      "$work/settings"
  else
    printf '\n[WiFi]\nEnable=true\n' >>"$work/settings"
  fi
  put "$work/settings" /var/lib/connman/settings 600
}

# The brick itself authorises them when it installs the package: it knows how.
put_keys() {
  printf '%s\n' "${keys[@]}" >"$work/keys"
  put "$work/keys" /var/cache/onbrick/keys 600
}

check_tools
check_name
read_keys
work=$(mktemp -d)
made=''
# An image that did not come to its end is none.
clean_up() {
  local status=$?
  rm -rf "$work"
  if [ $status != 0 ] && [ -n "$made" ]; then rm -f "$made"; fi
}
trap clean_up EXIT
check_image
find_deb
check_room
read_password
if [ -n "$out" ]; then
  [ ! -e "$out" ] || fail "$out is there already" "another name, or delete it"
  made=$out
  cp --reflink=auto --sparse=always "$image" "$out"
  image=$out
fi
put_package
[ -z "$name" ] || put_name
[ -z "$wifi" ] || put_wifi
[ ${#keys[@]} = 0 ] || put_keys
e2fsck -fn "$image?offset=$offset" >/dev/null 2>&1 ||
  fail "$image came out damaged" "unpack the image and try again"
say "put $(basename "$deb") into $image; the brick installs it at its first start," \
  "which takes a minute longer"
[ -z "$name" ] || say "it will be called $name: ssh robot@$name.local"
[ ${#keys[@]} = 0 ] || say "${#keys[@]} PC(s) may talk to it"
say "flash it, for example with Etcher"
