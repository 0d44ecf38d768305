"""Small MJCF arms of every oddity that MuJoCo takes, or nearly takes, as hypothesis draws them."""

from __future__ import annotations

from hypothesis import strategies as st

ODD_NUMBERS = ("nan", "inf", "-inf", "1e300", "-1e300", "1e-300", "0", "-1", "1e6")
AXES = ("0 0 1", "0 1 0", "1 0 0", "0 1 1", "0 0 -2", "1 0.1 0")
RANGES = ("-2 2", "-1 1", "0 0.5", "-170 170", "-3.1 0.1", "0 0.0001", "-6 6", "-2.5 2.5")
WORDS = ("", "flange", "tool", "home", "attachment_site", "läsion 1")


class Drawing:
    """What an arm is drawn with: hypothesis, and how often something odd is taken in place of what is usual."""

    def __init__(self, draw, odds: int) -> None:
        self.draw, self.odds = draw, odds

    def of(self, *choices):
        return self.draw(st.sampled_from(choices))

    def is_odd(self) -> bool:
        # Not the first or the last number, which hypothesis likes best.
        return self.draw(st.integers(0, self.odds)) == 3

    def usually(self, usual: str, *odd: str) -> str:
        return self.of(*odd) if self.is_odd() else usual

    def name(self, word: str) -> str:
        """An attribute with a name, or none."""
        return self.usually(f'name="{word}"', "")

    def numbers(self, *usual: str) -> str:
        return " ".join(self.usually(number, *ODD_NUMBERS) for number in usual)


def joint(drawing: Drawing, name: str) -> str:
    kind = drawing.usually(drawing.of("hinge", "hinge", "hinge", "slide"), "ball", "free")
    more = drawing.of("", "", 'armature="0.1"', 'stiffness="3"', 'ref="0.3"', 'pos="0.1 0 0"')
    if kind == "free":
        return f'<joint {drawing.name(name)} type="free"/>'
    axis = "" if kind == "ball" else f'axis="{drawing.of(*AXES)}"'
    span = drawing.numbers(*("0 2" if kind == "ball" else drawing.of(*RANGES)).split())
    limited = drawing.usually("true", "auto", "false")
    damping = drawing.usually("1", "-1", "1e9")
    return (
        f'<joint {drawing.name(name)} type="{kind}" {axis} limited="{limited}" range="{span}" '
        f'damping="{damping}" {more}/>'
    )


def geom(drawing: Drawing, name: str) -> str:
    kind = drawing.of("capsule", "sphere", "box", "cylinder", "ellipsoid", "mesh", "capsule")
    shape = f'type="{kind}" size="{drawing.numbers("0.03", "0.05", "0.04")}"'
    if kind == "mesh":
        shape = 'type="mesh" mesh="block"'
    place = f'pos="{drawing.numbers("0", "0", drawing.of("0.05", "0.1", "0.2"))}"'
    mass = drawing.usually("", 'mass="0"', 'density="0"', 'mass="-1"', 'mass="nan"')
    seen = drawing.of("", "", 'contype="0" conaffinity="0"', 'group="4"', 'class="shell"')
    return f"<geom {drawing.name(name)} {shape} {place} {mass} {seen}/>"


def links(drawing: Drawing, index: int, flange_at: int) -> str:
    """A body with the rest of the chain in it, and at times something beside."""
    n_joints = drawing.of(0, 1, 2) if index in (0, 3) else drawing.of(1, 2)
    inner = "".join(joint(drawing, f"j{index}{i}") for i in range(n_joints))
    inner += "".join(geom(drawing, f"g{index}_{i}") for i in range(drawing.of(1, 1, 2)))
    inner += drawing.of("", '<inertial pos="0 0 0.1" mass="1" diaginertia="0.1 0.1 0.1"/>')
    if index == flange_at:
        quat = drawing.of("", 'quat="0 1 0 0"', 'quat="0.7 0 0.7 0"', 'euler="0 90 0"')
        inner += f'<site name="flange" pos="{drawing.numbers("0", "0", drawing.of("0.1", "0.3"))}" {quat}/>'
    if drawing.of(1, 2, 3, 4) == 1:
        finger = joint(drawing, f"k{index}") + geom(drawing, f"f{index}")
        inner += f'<body {drawing.name(f"finger{index}")} pos="0.08 0 -0.05">{finger}</body>'
    if index < 5 and (index < flange_at or drawing.of(False, True)):
        inner += links(drawing, index + 1, flange_at)
    if drawing.of(*range(8)) == 0:
        inner = f'<frame pos="0 0 0.02">{inner}</frame>'
    place = drawing.numbers(drawing.of("0", "0.1"), "0", drawing.of("0.2", "0.3"))
    child = drawing.of("", "", 'childclass="slim"', 'gravcomp="1"')
    return f'<body {drawing.name(f"b{index}")} pos="{place}" {child}>{inner}</body>'


BESIDE = (
    '<body name="target" mocap="true" pos="0.4 0 0.5"><geom type="box" size="0.02 0.02 0.02"/></body>',
    '<body mocap="true"><geom size="0.02"/></body>',
    '<body name="cube" pos="0.5 0.3 0.5"><freejoint/><geom name="cube" type="box" size="0.02 0.02 0.02"/></body>',
    '<body pos="0.5 0.3 0.9"><freejoint/><geom size="0.02"/>'
    '<body pos="0 0 0.1"><joint type="ball"/><geom size="0.01"/></body></body>',
    '<site name="flange" pos="0.3 0 0.4"/>',
    '<geom type="plane" size="0 0 1"/>',
    '<geom type="hfield" hfield="ground"/>',
    '<camera mode="targetbody" target="b1"/>',
    '<light pos="0 0 3"/>',
    '<replicate count="2" offset="0 0.4 0"><body pos="0.9 0 0.2"><geom size="0.02"/></body></replicate>',
    '<flexcomp name="cloth" type="grid" count="3 3 1" spacing="0.1 0.1 0.1" radius="0.01" pos="0 0 2"/>',
    '<composite type="cable" curve="s" count="4 1 1" size="0.2" prefix="c"><joint kind="main" damping="0.1"/>'
    '<geom type="capsule" size="0.005"/></composite>',
    '<include file="beside.xml"/>',
    '<include file="gone.xml"/>',
)
EXTRA = (
    '<equality><joint joint1="j10" joint2="j20"/></equality>',
    '<equality><joint joint1="j10" active="false"/></equality>',
    '<equality><weld body1="b1" body2="b2"/></equality>',
    '<equality><weld body1="target" body2="b2"/></equality>',
    '<equality><connect body1="b0" body2="b2" anchor="0 0 0"/></equality>',
    '<equality><connect site1="flange" site2="spot"/></equality>',
    '<tendon><fixed name="t"><joint joint="j10" coef="1"/><joint joint="j20" coef="-1"/></fixed></tendon>',
    '<tendon><fixed limited="true" range="0 1"><joint joint="j10" coef="1"/></fixed></tendon>',
    '<tendon><spatial name="s"><site site="flange"/><site site="spot"/></spatial></tendon>',
    '<tendon><spatial><site site="spot"/><pulley divisor="2"/><site site="flange"/></spatial></tendon>',
    '<tendon><fixed name="t"><joint joint="j10" coef="1"/></fixed></tendon>'
    '<equality><tendon tendon1="t"/></equality>',
    '<actuator><position joint="j10" kp="10"/><motor joint="j20"/></actuator>',
    '<actuator><motor site="flange" gear="0 0 1 0 0 0"/></actuator>',
    '<tendon><fixed name="t"><joint joint="j10" coef="1"/><joint joint="j20" coef="1"/></fixed></tendon>'
    '<actuator><motor tendon="t"/></actuator>',
    '<actuator><general joint="j10" dyntype="filter" dynprm="1"/></actuator>',
    '<contact><exclude body1="b0" body2="b1"/></contact>',
    '<contact><exclude body1="cube" body2="b1"/></contact>',
    '<contact><pair geom1="g0_0" geom2="g2_0"/></contact>',
    '<sensor><framepos objtype="site" objname="flange"/><jointpos joint="j10"/></sensor>',
    '<custom><numeric name="n" data="1 2"/><text name="t" data="x"/></custom>',
    '<deformable><skin vertex="0 0 0 1 0 0 0 1 0" face="0 1 2"><bone body="b1" bindpos="0 0 0" bindquat="1 0 0 0" '
    'vertid="0 1 2" vertweight="1 1 1"/></skin></deformable>',
)
HEADS = (
    '<compiler angle="degree" autolimits="true"/>',
    '<compiler autolimits="false"/>',
    '<compiler fusestatic="true"/>',
    '<compiler boundmass="0.01" boundinertia="0.001"/>',
    '<compiler balanceinertia="true"/>',
    '<compiler inertiafromgeom="true"/>',
    '<compiler settotalmass="5"/>',
    '<compiler conflict="error"/>',
    '<compiler discardvisual="true"/>',
    '<option impratio="10" cone="elliptic" timestep="0.004"/>',
    '<option integrator="RK4" gravity="0 0 1" timestep="0"/>',
    '<option><flag equality="disable" contact="disable" sleep="enable"/></option>',
    '<option timestep="nan"/>',
    '<visual><map znear="1"/><quality offsamples="8"/></visual>',
    '<statistic extent="0.1" center="1 1 1"/>',
    '<size memory="10M" nkey="7" nuser_geom="2"/>',
)
DEFAULTS = """<default><geom {geom}/><joint {joint}/><default class="slim"><geom size="0.01"/>
<default class="shell"><geom contype="0" conaffinity="0" group="2"/><joint damping="2"/></default>
</default></default>"""
ASSETS = """<asset><mesh name="block" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .1"/><material name="m"/>
<hfield name="ground" nrow="2" ncol="2" size="1 1 0.1 0.1"/></asset>"""


def keyframe(drawing: Drawing, name: str) -> str:
    attributes = [drawing.of("", f'name="{name}"')]
    for attribute in ("qpos", "ctrl", "qvel", "act", "mpos"):
        if drawing.of(1, 2, 3) == 1:
            numbers = [drawing.of("0", "0.3", "-0.2", "1", "nan", "9") for _ in range(drawing.of(*range(9)))]
            attributes.append(f'{attribute}="{" ".join(numbers)}"')
    return f"<key {' '.join(attributes)}/>"


def some(drawing: Drawing, of: tuple[str, ...], most: int) -> str:
    return "".join(drawing.draw(st.lists(st.sampled_from(of), max_size=most, unique=True)))


@st.composite
def odd_arms(draw) -> str:
    """The text of an MJCF. Most are sound but for one or two oddities, the others have many."""
    drawing = Drawing(draw, draw(st.sampled_from([400, 400, 400, 60, 15])))
    most = {400: 1, 60: 2, 15: 3}[drawing.odds]
    defaults = DEFAULTS.format(
        geom=drawing.of("", 'type="capsule" size="0.03 0.05"', 'contype="2" conaffinity="2"'),
        joint=drawing.of("", 'axis="0 1 0" range="-2 2"', 'armature="0.01" damping="1"'),
    )
    beside = some(drawing, BESIDE, most)
    world = ["<site name='spot' pos='0.2 0 0.1'/>", links(drawing, 0, drawing.of(1, 2, 3, 4, 5))]
    world.insert(drawing.of(0, 2), beside)
    names = drawing.of((), ("home",), ("other", "ready"), ("home", "other", "ready"))
    keys = "".join(keyframe(drawing, name) for name in names)
    return (
        f'<mujoco model="{drawing.of(*WORDS)}"><compiler angle="radian"/>{some(drawing, HEADS, most)}{defaults}{ASSETS}'
        f"<worldbody>{''.join(world)}</worldbody>{some(drawing, EXTRA, most)}"
        f"{f'<keyframe>{keys}</keyframe>' if keys else ''}</mujoco>"
    )


BESIDE_FILE = "<mujocoinclude><body pos='0 0.8 0.3'><geom type='box' size='.1 .1 .1'/></body></mujocoinclude>"
"""What `beside.xml` holds."""
