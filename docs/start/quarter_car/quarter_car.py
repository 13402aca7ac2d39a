"""A quarter car as an FMU: pythonfmu build -f quarter_car.py"""

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class QuarterCar(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.ms, self.mu = 300.0, 40.0  # kg, body and wheel
        self.ks, self.cs, self.kt = 20e3, 1200.0, 180e3  # N/m, N s/m, N/m: spring, damper, tyre
        self.road = self.damper_force = 0.0  # m, N
        self.body = self.wheel = self.body_speed = self.wheel_speed = 0.0
        self.travel = self.travel_speed = 0.0  # m, m/s
        for name in ("ms", "mu", "ks", "cs", "kt"):
            self.register_variable(Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        for name in ("road", "damper_force"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("body", "travel", "travel_speed"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, time, step):
        h = step / 4
        for _ in range(4):
            force = self.ks * (self.body - self.wheel) + self.cs * (self.body_speed - self.wheel_speed)
            force += self.damper_force  # opposes a positive travel, as a spring does
            self.body_speed -= h * force / self.ms
            self.wheel_speed += h * (force - self.kt * (self.wheel - self.road)) / self.mu
            self.body += h * self.body_speed
            self.wheel += h * self.wheel_speed
        self.travel, self.travel_speed = self.body - self.wheel, self.body_speed - self.wheel_speed
        return True
