# shellcheck shell=dash
# One typed reading from a kept file of the kernel's own sysfs, against a bare C loop of pread and
# atoi on the same file, and beside it the same by crates.io's ev3dev-lang-rust.
brick_up
# A motor whose position is a file of sysfs: everything else of it is copied from the simulated one.
motor=/tmp/plain/sys/class/tacho-motor/motor0
mkdir -p $motor
for attribute in /tmp/brick/sys/class/tacho-motor/motor0/*; do
  if [ -f "$attribute" ]; then cp "$attribute" $motor/ 2>/dev/null || true; fi
done
echo "ev3-ports:outB" >$motor/address
rm -f $motor/position
ln -s /sys/class/net/lo/mtu $motor/position
brick_down

count=20000
c=$(probe read /sys/class/net/lo/mtu $count)
brick-figures reading /tmp/plain $count >/tmp/readings
ours=$(sed -n 's/^ours //p' /tmp/readings)
theirs=$(sed -n 's/^ev3dev-lang-rust //p' /tmp/readings)
figure "a reading in C" "$c" ns
figure "a typed reading" "$ours" ns
figure "a reading by ev3dev-lang-rust" "$theirs" ns
figure "typed reading against C" "$(awk "BEGIN { printf \"%.3f\", $ours / $c }")" times "<=" 1.15
