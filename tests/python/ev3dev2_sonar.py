"""The ultrasonic sensor in every mode; prints what it measured."""
import json
import time
from ev3dev2.sensor import INPUT_1
from ev3dev2.sensor.lego import UltrasonicSensor

# Between modes that are very different it repeats old values for a second, some say two.
SETTLE_S = 1.3

sonar = UltrasonicSensor(INPUT_1)
first_cm = [sonar.distance_centimeters for _ in range(5)]
said = {"address": sonar.address, "first_cm": first_cm, "modes": {}}
for mode in sonar.modes:
    sonar.mode = mode
    time.sleep(SETTLE_S)
    values = [sonar.value(index) for index in range(sonar.num_values)]
    said["modes"][mode] = [values, sonar.units, sonar.decimals]


def settled(read):
    read()
    time.sleep(SETTLE_S)
    return read()


said["cm"] = settled(lambda: sonar.distance_centimeters)
said["inches"] = settled(lambda: sonar.distance_inches)
said["hears_another"] = settled(lambda: sonar.other_sensor_present)
sonar.mode = sonar.MODE_US_SI_CM
time.sleep(SETTLE_S)
said["ping_cm"] = sonar.distance_centimeters_ping
print(json.dumps(said))
