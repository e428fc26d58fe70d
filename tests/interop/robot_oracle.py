"""Newton-Euler of robots from their URDF text in NumPy, link by link in the fixed frame; nothing of the library."""

import xml.etree.ElementTree as ET

import numpy as np


def _numbers(element, attribute, default):
    given = None if element is None else element.get(attribute)
    return np.array([float(x) for x in (given or default).split()])


def _skew(a):
    x, y, z = a
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def _about(axis, angle):
    """Rotation by Rodrigues' formula."""
    k = _skew(axis)
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def _origin(element):
    r, p, y = _numbers(element, "rpy", "0 0 0")
    turn = _about([0, 0, 1], y) @ _about([0, 1, 0], p) @ _about([1, 0, 0], r)
    return turn, _numbers(element, "xyz", "0 0 0")


class Robot:
    """Links and joints of a text; velocities are those of a floating base (world axes), then one a joint."""

    def __init__(self, text, floating=False, gravity=(0, 0, -9.81)):
        self.root = ET.fromstring(text)
        self.joints = {j.find("child").get("link"): j for j in self.root.iter("joint")}
        self.floating, self.gravity = floating, np.array(gravity, dtype=float)
        free = [j for j in self.root.iter("joint") if j.get("type") != "fixed" and j.find("mimic") is None]
        self.names = [j.get("name") for j in free]
        self.size = 6 * floating + len(free)

    def _path(self, link):
        path = []
        while link in self.joints:
            path.insert(0, self.joints[link])
            link = path[0].find("parent").get("link")
        return path

    def _value(self, joint, q):
        """Return the value of a joint and its derivative by the velocities."""
        mimic, row = joint.find("mimic"), np.zeros(self.size)
        if mimic is None:
            place = self.names.index(joint.get("name"))
            row[6 * self.floating + place] = 1
            return q[place], row
        followed = next(j for j in self.root.iter("joint") if j.get("name") == mimic.get("joint"))
        value, row = self._value(followed, q)
        factor = float(mimic.get("multiplier", 1))
        return factor * value + float(mimic.get("offset", 0)), factor * row

    def _motion(self, link, base, q, nu):
        """Return rotation, place, Jacobians, angular velocity and the biases of both accelerations of a link."""
        turn, place = base
        jv, jw = np.zeros((3, self.size)), np.zeros((3, self.size))
        if self.floating:
            jv[:, :3] = jw[:, 3:6] = np.eye(3)
        alpha, a = np.zeros(3), np.zeros(3)
        for joint in self._path(link):
            r, p = _origin(joint.find("origin"))
            arm = turn @ p
            omega = jw @ nu
            a = a + np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
            jv, place, turn = jv - _skew(arm) @ jw, place + arm, turn @ r
            if joint.get("type") == "fixed":
                continue
            axis = _numbers(joint.find("axis"), "xyz", "1 0 0")
            axis = axis / np.linalg.norm(axis)
            value, row = self._value(joint, q)
            along, rate = turn @ axis, row @ nu
            if joint.get("type") == "prismatic":
                arm = value * along
                a = a + np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm)) + 2 * rate * np.cross(omega, along)
                jv, place = jv - _skew(arm) @ jw + np.outer(along, row), place + arm
            else:
                alpha = alpha + rate * np.cross(omega, along)
                jw, turn = jw + np.outer(along, row), turn @ _about(axis, value)
        return turn, place, jv, jw, alpha, a

    def equations(self, q, nu, base=None, loads=False):
        """Return mass matrix and forces of M nu_dot = f."""
        base = (np.eye(3), np.zeros(3)) if base is None else base
        matrix, forces = np.zeros((self.size, self.size)), np.zeros(self.size)
        for link in self.root.iter("link"):
            inertial = link.find("inertial")
            if inertial is None:
                continue
            turn, _, jv, jw, alpha, a = self._motion(link.get("name"), base, q, nu)
            r, p = _origin(inertial.find("origin"))
            i = {k: float(v) for k, v in inertial.find("inertia").attrib.items()}
            second = np.array(
                [[i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]], [i["ixz"], i["iyz"], i["izz"]]]
            )
            second, mass = turn @ r @ second @ r.T @ turn.T, float(inertial.find("mass").get("value"))
            arm, omega = turn @ p, jw @ nu
            jv = jv - _skew(arm) @ jw
            a = a + np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
            matrix += mass * jv.T @ jv + jw.T @ second @ jw
            forces += jv.T @ (mass * (self.gravity - a))
            forces -= jw.T @ (second @ alpha + np.cross(omega, second @ omega))
        for joint in self.root.iter("joint") if loads else ():
            dynamics = joint.find("dynamics")
            if dynamics is not None:
                _, row = self._value(joint, q)
                rate = row @ nu
                forces -= row * (
                    float(dynamics.get("damping", 0)) * rate + float(dynamics.get("friction", 0)) * np.sign(rate)
                )
        return matrix, forces
