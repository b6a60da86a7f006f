"""A small job for certificates: two lines with a rounded corner, certified by two plans."""

CORNER_JOB = """
name: corner
arm: pmk3s
seed: [0, 1]
path: {points: [[0.30, 0.20], [0.36, 0.20], [0.36, 0.24]]}
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 2 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
certificate: {servo_error: 0.1 mm}
runs:
  only: {compensation: {method: pole_placement}}
"""
