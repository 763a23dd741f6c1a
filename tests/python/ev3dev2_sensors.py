"""Touch, colour and gyro in every mode; then turns by the gyro, drives to a line and to a wall."""
import json
import time
from ev3dev2.motor import OUTPUT_B, OUTPUT_D, MoveTank, SpeedPercent
from ev3dev2.sensor import INPUT_2, INPUT_3, INPUT_4, list_sensors
from ev3dev2.sensor.lego import ColorSensor, GyroSensor, TouchSensor

# What comes in the first moments after a change of mode is what that mode last measured, or 0.
SETTLE_S = 0.3

touch, eye, gyro = TouchSensor(INPUT_2), ColorSensor(INPUT_3), GyroSensor(INPUT_4)
said = {"sensors": sorted([sensor.address, sensor.driver_name] for sensor in list_sensors())}


def modes(sensor):
    found = {}
    for mode in sensor.modes:
        sensor.mode = mode
        time.sleep(SETTLE_S)
        values = [sensor.value(index) for index in range(sensor.num_values)]
        data = list(sensor.bin_data())
        found[mode] = [values, sensor.units, sensor.decimals, sensor.bin_data_format, data]
    return found


def settled(read):
    read()
    time.sleep(SETTLE_S)
    return read()


said["modes"] = {sensor.driver_name: modes(sensor) for sensor in (touch, eye, gyro)}
said["pressed"] = touch.is_pressed
said["reflected"] = settled(lambda: eye.reflected_light_intensity)
said["ambient"] = settled(lambda: eye.ambient_light_intensity)
said["colour"] = settled(lambda: eye.color_name)
said["rgb"] = settled(lambda: eye.raw)
eye.calibrate_white()
said["hsv"] = eye.hsv
said["angle_and_rate"] = settled(lambda: gyro.angle_and_rate)

tank = MoveTank(OUTPUT_B, OUTPUT_D)
colours = []
settled(lambda: eye.color)
tank.on(SpeedPercent(15), SpeedPercent(15))
while eye.color != ColorSensor.COLOR_BLACK:
    if eye.color not in colours:
        colours.append(eye.color)
    time.sleep(0.005)
tank.off()
said["colours_on_the_way"] = colours

settled(lambda: gyro.angle)
gyro.reset()
time.sleep(0.1)
said["reset_angle"] = gyro.angle
tank.gyro = gyro
tank.turn_right(speed=SpeedPercent(8), degrees=90)
time.sleep(0.3)
said["angle"] = gyro.angle
said["circle_angle"] = gyro.circle_angle()

tank.on(SpeedPercent(25), SpeedPercent(25))
said["bumped"] = touch.wait_for_pressed(timeout_ms=15000)
tank.off()
said["pressed_at_wall"] = touch.is_pressed
print(json.dumps(said))
