// Prints docs/derived.md: the report's equations (27)-(29) and (67)-(70) as the templates of
// firmware/mechanism make them of symbols. Nothing is typed in but the names.

#include <array>
#include <cstdio>
#include <exception>
#include <iostream>

#include "firmware/mechanism/matrices.hpp"
#include "tests/symbolic/laurent.hpp"

namespace esmc::test {
namespace {

using S = Laurent;

Laurent of(const std::string& name) { return Laurent::symbol(name); }

LegParams<S> leg(const std::string& j) {
  LegParams<S> p;
  p.l1 = of("l" + j + "1");
  p.l2 = of("l" + j + "2");
  p.lg1 = of("lg" + j + "1");
  p.lg2 = of("lg" + j + "2");
  return p;
}

template <int Rows>
void print_columns(const std::string& name, const std::array<const char*, 2>& columns,
                   const Mat<S, Rows, 2>& C, const std::vector<std::string>& p) {
  std::cout << "| row of " << name << " | p | " << columns[0] << " | " << columns[1]
            << " |\n|---|---|---|---|\n";
  for (int i = 0; i < Rows; ++i) {
    std::cout << "| " << i + 1 << " | " << p[static_cast<std::size_t>(i)] << " | " << C(i, 0).text() << " | "
              << C(i, 1).text() << " |\n";
  }
  std::cout << '\n';
}

template <int Rows, int Columns>
void print_sparse(const Mat<S, Rows, Columns>& A, const Vec<S, Rows>& b, const std::vector<std::string>& p) {
  std::cout << "| row | A, where it is not 0 | b |\n|---|---|---|\n";
  for (int i = 0; i < Rows; ++i) {
    std::cout << "| " << i + 1 << " | ";
    const char* separator = "";
    for (int k = 0; k < Columns; ++k) {
      if (A(i, k) == S(0)) continue;
      std::cout << separator << p[static_cast<std::size_t>(k)] << ": " << A(i, k).text();
      separator = "; ";
    }
    std::cout << " | " << b[i].text() << " |\n";
  }
  std::cout << '\n';
}

void add_leg_channels(std::vector<std::string>& p, const std::string& j) {
  for (const char* kind : {"theta", "omega"}) {
    for (const char* k : {"1", "2"}) p.push_back(kind + j + k + (*kind == 't' ? "'" : ""));
  }
  for (const char* k : {"1", "2"}) {
    for (const char* xy : {"vx", "vy"}) p.push_back(xy + j + k);
  }
}

void print_rr() {
  const Rr<S> m(RrParams<S>{leg(""), S(0)});
  trigonometry() = {{of("t1"), "1"}, {of("t2"), "2"}, {of("t1") + of("t2"), "12"}};
  const auto pose = m.pose({of("t1"), of("t2")});
  const Vec2<S> rate(of("omega1"), of("omega2") - of("omega1"));
  std::vector<std::string> p;
  add_leg_channels(p, "");
  std::cout
      << "## RR arm\n\nc1 = cos theta1, c12 = cos(theta1 + theta2), omega2 = theta1' + theta2'; s: sine.\n\n"
         "(27): p = C [theta1', theta2'].\n\n";
  print_columns<8>("C", {"theta1'", "theta2'"}, matrix_C(m, pose), p);
  std::cout << "(28), (29): A p' = b.\n\n";
  print_sparse<6, 8>(matrix_A(m, pose), vector_b(m, pose, rate), p);
}

void print_five_bar() {
  FiveBarParams<S> params;
  params.l0 = of("l0");
  params.legs = {leg("1"), leg("2")};
  const FiveBar<S> m(params);
  trigonometry().clear();
  Vec<S, 4> theta;
  FiveBar<S>::Rates rates;
  std::vector<std::string> p{"x'", "y'"};
  for (int i = 0; i < 2; ++i) {
    const std::string j = std::to_string(i + 1);
    const Laurent first = of("t" + j + "1"), second = of("t" + j + "2");
    trigonometry().insert(trigonometry().end(),
                          {{first, j + "1"}, {second, j + ",2"}, {first + second, j + ",12"}});
    theta.segment<2>(Eigen::Index{2} * i) << first, second;
    add_leg_channels(p, j);
  }
  const auto pose = m.pose(theta);
  for (int i = 0; i < 2; ++i) {
    const std::string j = std::to_string(i + 1);
    rates.leg[i] = {of("omega" + j + "1"), of("omega" + j + "2") - of("omega" + j + "1")};
  }
  std::cout << "## Five-bar\n\n"
               "c11 = cos theta11, s1,2 = sin theta12, c1,12 = cos(theta11 + theta12), omega12 = theta11' + "
               "theta12';\n"
               "the same for leg 2, whose rows live in its mirrored frame.\n\n"
               "(67): [x', y', theta11', theta12', theta21', theta22'] = C^ [x', y'].\n\n";
  print_columns<6>("C^", {"x'", "y'"}, matrix_Chat(m, pose), {p[0], p[1], p[2], p[3], p[10], p[11]});
  std::cout << "(68): p = C [x', y'].\n\n";
  print_columns<18>("C", {"x'", "y'"}, matrix_C(m, pose), p);
  std::cout << "(69), (70): A p' = b.\n\n";
  print_sparse<16, 18>(matrix_A(m, pose), vector_b(m, pose, rates), p);
}

}  // namespace
}  // namespace esmc::test

int main() try {
  std::cout << "# Derived equations\n\n"
               "Generated: `tests/symbolic/equations.cpp` sends symbols through the templates of "
               "`firmware/mechanism/` and\n"
               "prints what comes out; a test compares. Numbers in brackets are the report's equations, here "
               "without its\n"
               "misprints. Notation: [model.md](model.md).\n\n";
  esmc::test::print_rr();
  esmc::test::print_five_bar();
  return 0;
} catch (const std::exception& e) {
  std::fputs(e.what(), stderr);
  return 1;
}
