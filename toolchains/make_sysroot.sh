#!/usr/bin/env bash
# Makes a folder with the headers and libraries of a vehicle's system, to cross-compile against.
set -euo pipefail
usage() {
  cat <<'USAGE'
usage: toolchains/make_sysroot.sh [--arch arm64|armhf] [--distribution bookworm|jammy] [DEST]
       toolchains/make_sysroot.sh --from FOLDER [--arch arm64|armhf] [DEST]

The first fetches packages from the distribution's own archive (Debian 12 by default; jammy is Ubuntu 22.04) and unpacks them;
nothing of them is run, and it needs no root. The second copies what a vehicle has: FOLDER is its file system, mounted, or
copied with its usr/include, usr/lib, usr/share, lib, etc and var/lib/dpkg (which library is in which package: without it the names
that the .deb depends on are guessed). DEST is build/sysroot-<arch> by default and must not exist yet.
  --mirror URL   another archive than the distribution's
USAGE
}
fail() { echo "error: $1" >&2; exit 2; }

arch=arm64 distribution=bookworm from= mirror= dest=
while (($#)); do
  case $1 in
    --help) usage; exit 0 ;;
    --arch | --distribution | --from | --mirror)
      (($# > 1)) || fail "$1 lacks its value"
      declare "${1#--}=$2"
      shift 2 ;;
    -*) usage >&2; fail "$1 is no option" ;;
    *) [[ -z $dest ]] || fail "$1 is one too many"
      dest=$1
      shift ;;
  esac
done
case $arch in
  arm64) triplet=aarch64-linux-gnu ;;
  armhf) triplet=arm-linux-gnueabihf ;;
  *) fail "--arch takes arm64 or armhf, not $arch" ;;
esac
root=$(cd "$(dirname "$0")/.." && pwd)
dest=$(realpath -m "${dest:-$root/build/sysroot-$arch}")
[[ ! -e $dest ]] || fail "$dest exists: remove it or name another"
mkdir -p "$(dirname "$dest")"
part=$dest.part
rm -rf "$part"
trap 'rm -rf "$part"' EXIT

# What the on-board targets need, and their tests (GoogleTest; Ceres, with its BLAS and LAPACK, for automatic derivatives).
packages=(libc6-dev libeigen3-dev libboost-dev libyaml-cpp-dev libopencv-dev liblcm-dev libgtest-dev libgmock-dev libceres-dev libblas-dev liblapack-dev)

# The package data base that dpkg would have written: mmdebstrap unpacks only.
# shellcheck disable=SC2016  # $1 is the hook's: the folder
record='info=$1/var/lib/dpkg/info
for deb in "$1"/var/cache/apt/archives/*.deb; do
  name=$(dpkg-deb -f "$deb" Package)
  [ "$(dpkg-deb -f "$deb" Multi-Arch)" != same ] || name=$name:$(dpkg-deb -f "$deb" Architecture)
  dpkg-deb --fsys-tarfile "$deb" | tar -t | sed -e "s,^\.,," -e "s,\(.\)/\$,\1," >"$info/$name.list"
  for file in shlibs symbols; do
    dpkg-deb --ctrl-tarfile "$deb" | tar -xO "./$file" >"$info/$name.$file" 2>/dev/null || rm -f "$info/$name.$file"
  done
  { dpkg-deb -f "$deb" Package Architecture Multi-Arch Version Depends; printf "Status: install ok unpacked\n\n"; } >>"$1/var/lib/dpkg/status"
done'

fetch() {
  command -v mmdebstrap >/dev/null || fail "mmdebstrap is not here: apt-get install mmdebstrap"
  local sources keyring extra
  case $distribution in
    bookworm)
      mirror=${mirror:-http://deb.debian.org/debian}
      keyring=/usr/share/keyrings/debian-archive-keyring.gpg
      sources="deb $mirror bookworm main
deb $mirror bookworm-updates main"
      extra=(libstdc++-12-dev libexpected-dev libgeographiclib-dev libturbojpeg0-dev) ;;
    jammy)
      mirror=${mirror:-http://ports.ubuntu.com/ubuntu-ports}
      keyring=/usr/share/keyrings/ubuntu-archive-keyring.gpg
      sources="deb $mirror jammy main universe
deb $mirror jammy-updates main universe"
      extra=(libstdc++-11-dev libexpected-dev libgeographic-dev libturbojpeg0-dev) ;;
    *) fail "--distribution takes bookworm or jammy, not $distribution" ;;
  esac
  [[ -e $keyring ]] || fail "$keyring is not here: install the package of the archive's keys"
  local include
  include=$(IFS=,; echo "${packages[*]},${extra[*]}")
  local mode=chrootless
  ((EUID == 0)) && mode=root
  mmdebstrap --quiet --mode=$mode --variant=extract --arch="$arch" --include="$include" --keyring="$keyring" \
    --aptopt='Apt::Install-Recommends "false"' --aptopt='Acquire::Languages "none"' --extract-hook="$record" \
    "$distribution" "$part" - <<<"$sources"
  rm -rf "$part"/usr/share/{doc,man,locale} "$part"/var/cache/apt "$part"/dev
}

copy() {
  [[ -d $from/usr/include && -d $from/usr/lib/$triplet ]] || fail "$from has no usr/include or no usr/lib/$triplet"
  mkdir -p "$part/usr/share"
  cp -a "$from/usr/include" "$from/usr/lib" "$part/usr/"
  local folder
  for folder in cmake eigen3 pkgconfig; do
    if [[ -d $from/usr/share/$folder ]]; then cp -a "$from/usr/share/$folder" "$part/usr/share/"; fi
  done
  if [[ -L $from/lib ]]; then ln -s usr/lib "$part/lib"; elif [[ -d $from/lib ]]; then cp -a "$from/lib" "$part/"; fi
  for folder in alternatives ld.so.conf.d; do
    if [[ -d $from/etc/$folder ]]; then mkdir -p "$part/etc"; cp -a "$from/etc/$folder" "$part/etc/"; fi
  done
  mkdir -p "$part/var/lib/dpkg/info"
  if [[ -f $from/var/lib/dpkg/status && -d $from/var/lib/dpkg/info ]]; then
    cp -a "$from/var/lib/dpkg/status" "$part/var/lib/dpkg/"
    find "$from/var/lib/dpkg/info" \( -name '*.list' -o -name '*.shlibs' -o -name '*.symbols' \) -exec cp -a -t "$part/var/lib/dpkg/info" {} +
  else
    echo "warning: $from has no var/lib/dpkg: what the packages depend on is guessed" >&2
  fi
}

if [[ -n $from ]]; then copy; else fetch; fi
cd "$part"
# The alternatives of BLAS and LAPACK, which no maintainer's script has made.
for library in blas lapack; do
  for file in usr/lib/"$triplet/$library"/lib"$library".so*; do
    name=$(basename "$file")
    [[ -e $file && ! -e usr/lib/$triplet/$name ]] && ln -s "$library/$name" "usr/lib/$triplet/$name"
  done
done || true
# Absolute links would lead out of the sysroot.
find . -xdev -type l -lname '/*' | while read -r link; do
  ln -sfn "$(realpath -m --relative-to="$(dirname "$link")" ".$(readlink "$link")")" "$link"
done
# So would the absolute paths in exported CMake targets.
{ grep -rlE '[";]/usr/(lib|include)' usr/lib/*/cmake usr/lib/cmake usr/share/cmake 2>/dev/null || true; } | while read -r file; do
  sed -i -E '/INTERFACE_(LINK|INCLUDE)/ s#([";])/usr/(lib|include)#\1${CMAKE_SYSROOT}/usr/\2#g' "$file"
done
mkdir -p dev proc sys tmp mnt  # where a guest or a chroot mounts its own
cd - >/dev/null
mv "$part" "$dest"
trap - EXIT
echo "$dest"
