#!/usr/bin/env bash
# prepare_guest.sh DEST: an aarch64 guest for QEMU in DEST: Debian's kernel (vmlinuz) and an initramfs (initrd) with busybox and
# the modules of vivid and virtio. Fetched with a package root of its own: the machine's package state is not touched.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
dest=$(realpath -m "$1")
[[ ! -e $dest/initrd ]] || exit 0
for program in apt-get dpkg depmod modprobe cpio; do
  command -v "$program" >/dev/null || { echo "error: $program is not here (packages kmod, cpio)" >&2; exit 1; }
done
work=$dest.work
rm -rf "$work"
mkdir -p "$work"/{lists/partial,cache/archives/partial,deb,root,initrd/bin,initrd/modules} "$dest"
trap 'rm -rf "$work"' EXIT
: >"$work/status"
echo "deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] http://deb.debian.org/debian bookworm main" >"$work/sources.list"
cat >"$work/apt.conf" <<CONF
APT::Architecture "arm64"; APT::Architectures { "arm64"; }; APT::Sandbox::User "root"; Acquire::Languages "none";
Dir::Etc::SourceList "$work/sources.list"; Dir::Etc::SourceParts "-"; Dir::State::Status "$work/status";
Dir::State::Lists "$work/lists"; Dir::Cache "$work/cache";
CONF
export APT_CONFIG=$work/apt.conf
apt-get -qq update
kernel=$(apt-cache depends linux-image-arm64 | sed -n 's/^ *Depends: \(linux-image-[^ ]*\)$/\1/p' | head -n 1)
(cd "$work/deb" && apt-get -qq download "$kernel" busybox-static)
for deb in "$work"/deb/*.deb; do dpkg -x "$deb" "$work/root"; done

version=${kernel#linux-image-}
cp "$work"/root/bin/busybox "$work/initrd/bin/"
cp "$here/guest_init.sh" "$work/initrd/init"
chmod +x "$work/initrd/init"
depmod -b "$work/root" "$version"
# In the order in which they must be loaded.
for module in virtio_pci virtio_mmio 9pnet_virtio 9p vivid; do
  modprobe -d "$work/root" -S "$version" --show-depends "$module" | sed -n 's/^insmod \([^ ]*\).*/\1/p'
done | awk '!seen[$0]++' | while read -r file; do
  cp "$file" "$work/initrd/modules/"
  basename "$file" >>"$work/initrd/modules/order"
done
(cd "$work/initrd" && find . | cpio -o -H newc --quiet | gzip -1) >"$dest/initrd.part"
cp "$work"/root/boot/vmlinuz-* "$dest/vmlinuz"
mv "$dest/initrd.part" "$dest/initrd"
