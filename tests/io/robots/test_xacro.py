"""Xacro files are programs: refused without trust, guarded with it."""

import os
import re
import subprocess
import sys

import pytest
from tests.io.tables import refusals, rows

import armcontour as ac
from armcontour._xacro.expressions import OPERATIONS, Refused, compile_expression

pytest.importorskip("xacro")

HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
ARM = (
    '<link name="base"/><link name="hand"/><joint name="turn" type="revolute">'
    '<parent link="base"/><child link="hand"/>'
    '<limit lower="-1" upper="1" velocity="2" effort="3"/></joint>'
)
# Three programs that touch a file; each gets past xacro's own check of names.
ESCAPES = (
    "(lambda f: f.__globals__['os'].system('touch PWNED'))(xacro.load_yaml)",
    "(lambda: [c for c in ().__class__.__base__.__subclasses__() if c.__name__ == "
    "'_wrap_close'][0].__init__.__globals__['system']('touch PWNED'))()",
    "[c.__init__.__globals__['system']('touch PWNED') for c in "
    "().__class__.__base__.__subclasses__() if c.__name__ == '_wrap_close']",
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
    assert arm.forward([0.0]) == pytest.approx([1.0, 2.0, 1.0])


def test_programs_do_not_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for program in ESCAPES:
        value = program.replace("<", "&lt;")
        file = write(tmp_path, f'<xacro:property name="p" value="${{{value}}}"/>{link("x${p}")}')
        untrusted = "robot.xacro ... is a program that can run anything ... --trust-xacro"
        refusals(ac.load_arm, [(file, untrusted)])
        refusals(load, [(file, "robot.xacro ... which is refused")])
        assert os.listdir(tmp_path) == ["robot.xacro"]


# What links are called; the reader of `$(...)` sees no parenthesis in `\\x29`.
LINKS = r"""
${xacro.load_yaml('/etc/passwd')} => '/etc/passwd' ... outside of the folder
${xacro.load_yaml('../secret.yaml')} => secret.yaml ... outside of the folder
${xacro.load_yaml('link.yaml')} => link.yaml ... outside of the folder
$(env PATH) => variable 'PATH' ... environment is not read
$(optenv PATH none) => variable 'PATH' ... environment is not read
$(eval env('PATH'${'\x29'}) => variable 'PATH'
$(eval open('/etc/passwd'${'\x29'}) => name 'open' is not defined
$(find ../../etc) => not the name of a package
${9**9**9} => more than 4096 bits
$(eval 9**9**9) => more than 4096 bits
${'a' * 10**9} => more than 100000 items
${list(python.range(10**30))} => more than 100000 items
${math.factorial(10**7)} => more than 4096 bits
${math.prod(['a'], start=10**9)} => prod ... no bound
$(eval comb(10**6, 10**5${'\x29'}) => comb ... no bound
${python.vars(xacro)} => 'vars' is not defined
${python.type(1)} => 'type' is not defined
${lost} => cannot be expanded by xacro ... 'lost' is not defined
"""
BODIES = """
<xacro:include filename="linked/secret.xacro"/> => outside of the folder
<xacro:include filename="../*.xacro"/> => outside of the folder
<xacro:macro name="a"><xacro:a/></xacro:macro><xacro:a/> => macros ... 100 deep
<xacro:include filename="robot.xacro"/> => include one another ... 100 deep
<xacro:include filename="none.xacro"/> => none.xacro ... No such file
"""


def test_what_a_trusted_file_must_not_do(tmp_path):
    folder = tmp_path / "robot"
    folder.mkdir()
    for name in ("secret.yaml", "secret.xacro"):
        (tmp_path / name).write_text("<robot/>")
    (folder / "link.yaml").symlink_to(tmp_path / "secret.yaml")
    (folder / "linked").symlink_to(tmp_path)
    times = '<xacro:macro name="a" params="__times"><link name="${[1] * 10**9}"/></xacro:macro>'
    double = '<xacro:property name="a{}" value="${{a{}}}${{a{}}}"/>'
    doubled = "".join(double.format(i, i - 1, i - 1) for i in range(1, 40)) + link("${a39}")
    more = [
        (times + '<xacro:a __times="${max}"/>', "more than 100000 items"),
        (
            '<xacro:property name="a0" value="aaaaaaaaaa"/>' + doubled,
            "a text of more than 1000000 characters",
        ),
        (link("${" + "-" * 9000 + "1}"), "nested too deeply"),
    ]
    table = [(link(x), words) for x, words in rows(LINKS)] + rows(BODIES) + more
    refusals(lambda x: load(write(folder, x)), table, "robot.xacro")


def test_modules_beside_the_file_are_not_imported(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("xacro", "yaml", "json", "armcontour"):
        (tmp_path / f"{name}.py").write_text("open('PWNED', 'w')")
    assert load(write(tmp_path, ARM)).dof == 1
    assert not (tmp_path / "PWNED").exists()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes with names")
def test_pipes_and_devices_are_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe.yaml")
    file = write(tmp_path, link("${xacro.load_yaml('pipe.yaml')}"))
    refusals(load, [(file, "pipe.yaml is not a regular file")])


def test_files_of_packages_that_are_found_are_read(tmp_path, monkeypatch):
    index, share = tmp_path / "index", tmp_path / "share"
    for folder in (index / "ament_index_python", share / "arms", tmp_path / "robot"):
        folder.mkdir(parents=True)
    (index / "ament_index_python" / "__init__.py").write_text("")
    (index / "ament_index_python" / "packages.py").write_text(
        f"def get_package_share_directory(name):\n    return {str(share)!r} + '/' + name\n"
    )
    monkeypatch.syspath_prepend(index)
    write(share / "arms", ARM, "arm.xacro")
    include = '<xacro:include filename="$(find arms)/{}arm.xacro"/>'
    assert load(write(tmp_path / "robot", include.format(""))).dof == 1
    write(share, ARM, "arm.xacro")
    # Without that package, its folder is outside like any other.
    outside = (include.format("../"), include.replace("$(find arms)", f"{share}/arms"))
    table = [(x, "outside of the folder") for x in outside]
    refusals(lambda x: load(write(tmp_path / "robot", x)), table)


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
    for i, (own, other) in enumerate((
        ("ws/arms", "ws/arms"),
        ("ws/arms", "ws/shared"),
        ("ws/arms", "ws/arms/inner"),
        ("src/repository/arms", "src/shared"),
        ("src/repository/arms", "src/other/shared"),
    )):  # fmt: skip
        folder = package(tmp_path / str(i) / own, "arms")
        if other != own:
            package(tmp_path / str(i) / other, "shared_parts")
        name = "arms" if other == own else "shared_parts"
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
    arm = ac.load_arm(file, trust_xacro=True, packages={"shared": far})
    assert arm.joint_names == ("twist",)


def test_a_package_that_is_not_found_is_named_where_it_is_read(tmp_path):
    words = "it reads files of the package 'far' ... packages={'far': ...} ... --package far="
    far = INCLUDE.format("far")
    bodies = (
        far,
        far.replace("arm.xacro", "*.xacro"),
        far.replace("<xacro:include", '<xacro:include optional="true"'),
        link("${xacro.load_yaml('$(find far)/a.yaml')}"),
    )
    refusals(lambda x: load(write(tmp_path, x)), [(x, words) for x in bodies])
    # Only named, as by controllers of a simulator, it does no harm.
    file = write(tmp_path, f"<gazebo><p>$(find far)/c.yaml</p></gazebo>{ARM}")
    assert load(file).dof == 1
    none = [({"far": tmp_path / "none"}, "The folder of the package far, ... is not there")]
    refusals(lambda x: ac.load_arm(file, trust_xacro=True, packages=x), none)


def test_files_outside_of_packages_stay_unread(tmp_path):
    package(tmp_path / "ws" / "arms", "arms")
    (tmp_path / "ws" / "secret.yaml").write_text("a: 1")
    (tmp_path / "ws" / "plain").mkdir()
    write(tmp_path / "ws" / "plain", ARM, "arm.xacro")
    package(tmp_path / "ws" / "shared", "shared")
    # A folder without a package file, a file beside the packages, a package that is not named.
    outside = (
        link("${xacro.load_yaml('../secret.yaml')}"),
        INCLUDE.replace("$(find {})", "../plain"),
        INCLUDE.replace("$(find {})", "../shared"),
        INCLUDE.replace("$(find {})", "$(find shared)/../plain"),
    )
    table = [(x, "outside of the folder") for x in outside]
    table += [(INCLUDE.format("plain"), "it reads files of the package 'plain'")]
    refusals(lambda x: load(write(tmp_path / "ws" / "arms", x)), table)


def test_arguments_are_given(tmp_path):
    named = ARM.replace('"hand"', '"l$(arg size)_$(arg soft)"')
    file = write(tmp_path, '<xacro:arg name="soft" default="no"/>' + named)
    for arguments, name in (
        ({"size": "3"}, "l3_no"),
        ({"size": 4, "soft": True}, "l4_true"),
        ({"size": 0.5}, "l0.5_no"),
    ):
        assert ac.load_arm(file, trust_xacro=True, arguments=arguments, tip=name).dof == 1


def test_arguments_that_lack_or_are_too_many_are_named(tmp_path):
    size = "it needs a value of its argument 'size' ... --xacro-arg size=VALUE"
    texts = ("$(arg size)", "${xacro.arg('size')}", r"$(eval arg('size'${'\x29'})")
    refusals(lambda x: load(write(tmp_path, link(x))), [(x, size) for x in texts])
    file = write(tmp_path, '<xacro:arg name="soft" default="no"/>' + ARM)
    (tmp_path / "robot.urdf").write_text(f"{HEAD}{ARM}</robot>")
    trusted = {"trust_xacro": True}
    table = [
        (
            file,
            {"arguments": {"sofd": True}, **trusted},
            "it has no argument 'sofd': it takes soft",
        ),
        (file, {"arguments": {"soft": [1]}, **trusted}, "The argument soft ... must be text"),
        (tmp_path / "robot.urdf", {"arguments": {"a": 1}}, "takes no arguments"),
        ("ur5e", {"arguments": {"a": 1}}, "packages or arguments"),
        ("ur5e", {"packages": {"a": tmp_path}}, "packages or arguments"),
    ]
    refusals(lambda x: ac.load_arm(x[0], **x[1]), [((a, b), words) for a, b, words in table])


CALLS = """
os.system('touch PWNED') => it calls os.system
open('PWNED', 'w') => it writes 'PWNED'
open('/etc/passwd') => it reads '/etc/passwd'
os.listdir('/') => it reads '/'
os.fork() => it calls os.fork
__import__('ctypes') => it loads the module
__import__('_posixsubprocess') => it loads the module
os.environ.update(a='b') => it calls os.putenv
"""


def test_what_gets_past_the_checks_of_expressions_is_stopped_too(tmp_path):
    table = rows(CALLS)
    program = f"""
import os
from armcontour._xacro import guard
guard.watch(guard.Reading({str(tmp_path / "robot.xacro")!r}))
for call in {[x for x, _ in table]}:
    try:
        eval(call)
    except BaseException as error:
        print(type(error).__name__, error)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True
    )
    said = done.stdout.splitlines()
    assert len(said) == len(table), done.stderr
    assert [y for (_, x), y in zip(table, said, strict=True) if f"Refused {x}" not in y] == []
    assert not os.listdir(tmp_path)


def evaluate(text, **symbols):
    return eval(compile_expression(text), {"__builtins__": OPERATIONS, **symbols})


def test_plain_expressions_keep_their_values():
    for text, value in (
        ("2**0.5 * -3 + 7 % 4 - (1 << 4)", 2**0.5 * -3 + 3 - 16),
        ("[1, 2] * 2 + x[1:]", [1, 2, 1, 2, 5]),
        ("'%s_%.3f' % ('a', 1/3)", "a_0.333"),
        ("'a' if x[0] > 1 and not x[1] in (2, 3) else {'b': [*x]}", "a"),
        ("'a_b'.split('_')[0].upper()", "A"),
        ("2 ** 2000 // 2 ** 1999", 2),
    ):
        assert evaluate(text, x=[4, 5]) == value, text


ATTRIBUTES = "__class__ _private gi_frame cr_frame ag_frame tb_frame f_globals func_globals".split()
REFUSED = """
lambda: 1 => a lambda
[x for x in y] => a comprehension
{x for x in y} => a comprehension
{x: x for x in y} => a comprehension
list(x for x in y) => a generator
f'{x}' => a formatted string
(x := 1) => an assignment
'{0.__class__}'.format(x) => the attribute format
'{a}'.format_map(x) => the attribute format_map
'a'.rjust(10**9) => the attribute rjust
__builtins__ => the name __builtins__
__power(9, 9) => the name __power
'%99999999d' % 1 => a width above 100
'%*d' % (10**9, 1) => a width above 100
1 << 10**9 => more than 4096 bits
10**9 * [0] => more than 100000 items
x**x**x => more than 4096 bits
"""


def test_expressions_that_are_refused():
    long = ("x" * 20_000, "20000 characters")
    attributes = [(f"x.{name}", f"the attribute {name}") for name in ATTRIBUTES]
    for text, words in [*rows(REFUSED), *attributes, long]:
        with pytest.raises(Refused, match=re.escape(words)):
            evaluate(text, x=999)
