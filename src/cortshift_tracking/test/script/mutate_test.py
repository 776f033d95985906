"""Faults are drawn alike from alike sources, and each changes code in one place."""
import itertools

from scripts import script

mutate = script('mutate')

SOURCE = """// a + b in a comment
#include <vector>
constexpr double kBound = 0.5;  // [m]
template <int N>
double f(double a, double b) {
  const std::vector<float> none;
  if (a < b && !none.empty()) return g(a, b);
  say("a + b");
  for (int i = 0; i < 3; ++i) a += x[i + 1] * b;
  return std::max(a, -b) - 2.5f;
}
"""


def faults():
    return mutate.faults_of('src/cortshift_flow/src/f.cpp', SOURCE)


def test_every_kind_is_found_where_it_is():
    found = {(fault.kind, fault.after) for fault in faults()}
    for kind, after in [
            ('weight', 'constexpr double kBound = 1;  // [m]'),
            ('comparison', 'if (a <= b && !none.empty()) return g(a, b);'),
            ('comparison', 'if (a < b || !none.empty()) return g(a, b);'),
            ('comparison', 'if (a < b && none.empty()) return g(a, b);'),
            ('swapped arguments', 'if (a < b && !none.empty()) return g(b, a);'),
            ('bound', 'for (int i = 1; i < 3; ++i) a += x[i + 1] * b;'),
            ('bound', 'for (int i = 0; i < 4; ++i) a += x[i + 1] * b;'),
            ('index', 'for (int i = 0; i < 3; ++i) a += x[i - 1] * b;'),
            ('index', 'for (int i = 0; i < 3; ++i) a += x[i + 2] * b;'),
            ('sign', 'for (int i = 0; i < 3; ++i) a -= x[i + 1] * b;'),
            ('dropped term', 'for (int i = 0; i < 3; ++i) a += x[i + 1];'),
            ('sign', 'return std::max(a, b) - 2.5f;'),
            ('bound', 'return std::min(a, -b) - 2.5f;'),
            ('sign', 'return std::max(a, -b) + 2.5f;'),
            ('bound', 'return std::max(a, -b) - 5.f;')]:
        assert (kind, after) in found, (kind, after)


def test_comments_strings_and_templates_are_left_alone():
    assert {fault.line for fault in faults()} <= {3, 7, 9, 10}


def test_the_draw_depends_on_the_seed_alone():
    kinds = mutate.all_faults(mutate.ROOT)
    drawn = [[str(fault) for fault in itertools.islice(mutate.draw(kinds, seed), 40)] for seed in (1, 1, 2)]
    assert drawn[0] == drawn[1] != drawn[2]
    assert len(set(drawn[0])) == 40


def test_only_cores_are_changed():
    paths = {fault.path for faults in mutate.all_faults(mutate.ROOT).values() for fault in faults}
    assert {path.split('/')[1] for path in paths} == {'cortshift_flow', 'cortshift_stereo', 'cortshift_tracking'}
    assert not any('/ros/' in path or '/nodes/' in path or '/tools/' in path or '/test/' in path for path in paths)
