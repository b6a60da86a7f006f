"""Xacro files are programs: refused without trust, expanded in a child process with it."""

import sys

import pytest
from tests.files.tables import refusals

import armcontour as ac

pytest.importorskip("xacro")

HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
ARM = (
    '<link name="base"/><link name="hand"/><joint name="turn" type="revolute">'
    '<parent link="base"/><child link="hand"/>'
    '<limit lower="-1" upper="1" velocity="2" effort="3"/></joint>'
)


def write(folder, body, name="robot.xacro"):
    file = folder / name
    file.write_text(f"{HEAD}{body}</robot>")
    return file


def load(file):
    return ac.load_arm(file, trust_xacro=True)


def link(expression):
    escaped = expression.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    return f'<link name="{escaped}"/>'


def test_a_trusted_file_becomes_an_arm(tmp_path):
    (tmp_path / "sizes.yaml").write_text("reach: 0.25\nrange: {upper: !degrees 90}\n")
    macro = ARM.replace('upper="1"', 'upper="${upper}"')
    macro = f'<xacro:macro name="arm" params="upper">{macro}</xacro:macro>'
    write(tmp_path, macro, "arm.xacro")
    body = (
        '<xacro:include filename="arm.xacro"/>'
        '<xacro:property name="sizes" value="${xacro.load_yaml(\'sizes.yaml\')}"/>'
        '<xacro:arm upper="${sizes.range.upper}"/><link name="tip"/>'
        '<joint name="end" type="fixed"><parent link="hand"/><child link="tip"/>'
        '<origin xyz="${sizes.reach * 2**2} $(eval 1 + 1) ${sin(pi / 2) % 2}"/></joint>'
    )
    arm = load(write(tmp_path, body))
    assert arm.limits.joint_upper == pytest.approx([1.5707963])
    assert arm.tool_position([0.0]) == pytest.approx([1.0, 2.0, 1.0])


def test_without_trust_nothing_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    program = (
        "[c.__init__.__globals__['system']('touch RAN') for c in "
        "().__class__.__base__.__subclasses__() if c.__name__ == '_wrap_close']"
    )
    file = write(tmp_path, f'<xacro:property name="p" value="${{{program}}}"/>{link("x${p}")}')
    refusals(ac.load_arm, [(file, "robot.xacro ... is a program ... --trust-xacro")])
    assert list(tmp_path.iterdir()) == [file]


def test_files_that_xacro_cannot_expand_are_refused(tmp_path, monkeypatch):
    bodies = [
        (link("${lost}"), "'lost' is not defined"),
        ('<xacro:include filename="none.xacro"/>', "none.xacro"),
        ('<xacro:include filename="robot.xacro"/>', "recursion"),
    ]
    words = "robot.xacro cannot be expanded by xacro"
    refusals(lambda x: load(write(tmp_path, x)), bodies, words)
    macro = '<xacro:macro name="arm" params=""><link name="base"/></xacro:macro>'
    refusals(
        lambda x: load(write(tmp_path, x)), [(macro, "produces no links ... only defines macros")]
    )
    monkeypatch.setitem(sys.modules, "xacro", None)
    refusals(lambda x: load(write(tmp_path, x)), [(ARM, "pip install 'armcontour[ros]'")])


def test_a_process_that_ends_early_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.executable", "/bin/true")
    file = write(tmp_path, ARM)
    refusals(load, [(file, "robot.xacro ... ended without a result")])
    monkeypatch.setattr("sys.executable", str(tmp_path / "none"))
    refusals(load, [(file, "robot.xacro ... cannot be started")])


def test_modules_beside_the_file_are_not_imported(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("xacro", "yaml", "json", "armcontour"):
        (tmp_path / f"{name}.py").write_text("open('PWNED', 'w')")
    assert load(write(tmp_path, ARM)).dof == 1
    assert not (tmp_path / "PWNED").exists()


INCLUDE = '<xacro:include filename="$(find {})/arm.xacro"/>'


def package(folder, name, body=ARM):
    """A package with a file arm.xacro."""
    folder.mkdir(parents=True)
    # The name in a comment is none.
    text = f"<package><!-- <name>x</name> --><name>{name}</name></package>"
    (folder / "package.xml").write_text(text)
    write(folder, body, "arm.xacro")
    return folder


def test_packages_are_found_by_their_package_file(tmp_path):
    for i, (own_folder, other) in enumerate((
        ("ws/arms", "ws/arms"),
        ("ws/arms", "ws/shared"),
        ("ws/arms", "ws/arms/inner"),
    )):  # fmt: skip
        folder = package(tmp_path / str(i) / own_folder, "arms")
        if other != own_folder:
            package(tmp_path / str(i) / other, "shared_parts")
        name = "arms" if other == own_folder else "shared_parts"
        (folder / "urdf").mkdir()
        assert load(write(folder / "urdf", INCLUDE.format(name))).dof == 1
    # Of packages of one name the named one is read, then the nearest.
    two = ARM.replace('name="turn"', 'name="twist"')
    arms, far = tmp_path / "ws" / "arms", tmp_path / "far" / "shared"
    for folder, name, body in (
        (arms, "arms", ARM),
        (tmp_path / "ws" / "shared", "shared", ARM),
        (far, "shared", two),
    ):
        package(folder, name, body)
    file = write(arms, INCLUDE.format("shared"))
    assert load(file).joint_names == ("turn",)
    arm = ac.load_arm(file, ac.ArmOptions(packages={"shared": far}), trust_xacro=True)
    assert arm.joint_names == ("twist",)


def test_a_package_that_is_not_found_is_named_where_it_is_read(tmp_path):
    words = "it reads files of the package 'far' ... packages={'far': ...} ... --package far="
    far = INCLUDE.format("far")
    bodies = (
        far,
        link("${xacro.load_yaml('$(find far)/a.yaml')}"),
    )
    refusals(lambda x: load(write(tmp_path, x)), [(x, words) for x in bodies])
    # Only named, as by controllers of a simulator, it does no harm.
    file = write(tmp_path, f"<gazebo><p>$(find far)/c.yaml</p></gazebo>{ARM}")
    assert load(file).dof == 1
    none = [({"far": tmp_path / "none"}, "The folder of the package far, ... does not exist")]
    refusals(lambda x: ac.load_arm(file, ac.ArmOptions(packages=x), trust_xacro=True), none)


def test_arguments_are_given(tmp_path):
    named = ARM.replace('"hand"', '"l$(arg size)_$(arg soft)"')
    file = write(tmp_path, '<xacro:arg name="soft" default="no"/>' + named)
    for arguments, name in (
        ({"size": "3"}, "l3_no"),
        ({"size": 4, "soft": True}, "l4_true"),
        ({"size": 0.5}, "l0.5_no"),
    ):
        options = ac.ArmOptions(arguments=arguments, tip=name)
        assert ac.load_arm(file, options, trust_xacro=True).dof == 1


def test_arguments_that_lack_or_are_too_many_are_named(tmp_path):
    size = "it requires a value of its argument 'size' ... --xacro-arg size=VALUE"
    texts = ("$(arg size)", "${xacro.arg('size')}", r"$(eval arg('size'${'\x29'})")
    refusals(lambda x: load(write(tmp_path, link(x))), [(x, size) for x in texts])
    file = write(tmp_path, '<xacro:arg name="soft" default="no"/>' + ARM)
    (tmp_path / "robot.urdf").write_text(f"{HEAD}{ARM}</robot>")
    table = [
        ((file, {"sofd": True}), "it has no argument 'sofd'. Its arguments are soft"),
        ((tmp_path / "robot.urdf", {"a": 1}), "has no arguments"),
        (("ur5e", {"a": 1}), "no option arguments"),
    ]
    loaded = lambda x: ac.load_arm(x[0], ac.ArmOptions(arguments=x[1]), trust_xacro=True)  # noqa: E731
    refusals(loaded, table)
