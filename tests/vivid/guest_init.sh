#!/bin/busybox sh
# The guest's first and only program: vivid with its HDMI output looped into its HDMI input, the host's folders `sysroot` and
# `share`, then /share/job.sh, whose output is the console; its exit code goes to share/job.rc.
/bin/busybox mkdir -p /proc /sys /dev /tmp /sysroot
/bin/busybox --install -s /bin
export PATH=/bin
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t devtmpfs dev /dev
while read -r module; do
  case $module in
    vivid.ko) insmod /modules/$module n_devs=1 node_types=0x101 num_inputs=1 input_types=0x3 num_outputs=1 output_types=0x1 ;;
    *) insmod /modules/$module 2>/dev/null ;;
  esac
done </modules/order
options=trans=virtio,version=9p2000.L,msize=262144
mount -t 9p -o ro,cache=loose,$options sysroot /sysroot || poweroff -f
for folder in proc sys dev; do mount -o bind /$folder /sysroot/$folder; done
mount -t tmpfs tmpfs /sysroot/tmp
mount -t 9p -o $options share /sysroot/mnt || poweroff -f
ip link set lo up
ip link set lo multicast on
ip route add 224.0.0.0/4 dev lo
cd /sysroot/mnt
sh ./job.sh
echo $? >job.rc
cd /
sync
poweroff -f
