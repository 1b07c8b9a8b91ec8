#pragma once
/// Dormand-Prince 8(5,3), known as DOP853: HNW II.5.

#include "host_sim/integrate/dormand_prince.hpp"

namespace esmc::host {

/// Coefficients, HNW (II.5.20) and the appendix; the numbers as Hairer and Wanner publish them with their
/// code. Stages count from 0: 0..11 the method, 12 the slope at the end of the step.
namespace dopri8 {
inline constexpr std::size_t stages = 13;
using Row = std::array<double, stages>;

inline constexpr Row c{0.0,
                       0.0526001519587677318785587544488,
                       0.0789002279381515978178381316732,
                       0.11835034190722739672675719751,
                       0.28164965809277260327324280249,
                       0.333333333333333333333333333333,
                       0.25,
                       0.307692307692307692307692307692,
                       0.651282051282051282051282051282,
                       0.6,
                       0.857142857142857142857142857142,
                       1.0,
                       1.0};

/// Row 12 is the solution of order 8.
inline constexpr std::array<Row, stages> a{{
    {},
    {0.0526001519587677318785587544488},
    {0.0197250569845378994544595329183, 0.0591751709536136983633785987549},
    {0.0295875854768068491816892993775, 0.0, 0.0887627564304205475450678981324},
    {0.241365134159266685502369798665, 0.0, -0.884549479328286085344864962717,
     0.924834003261792003115737966543},
    {0.037037037037037037037037037037, 0.0, 0.0, 0.170828608729473871279604482173,
     0.125467687566822425016691814123},
    {0.037109375, 0.0, 0.0, 0.170252211019544039314978060272, 0.0602165389804559606850219397283,
     -0.017578125},
    {0.0370920001185047927108779319836, 0.0, 0.0, 0.170383925712239993810214054705,
     0.107262030446373284651809199168, -0.0153194377486244017527936158236,
     0.00827378916381402288758473766002},
    {0.624110958716075717114429577812, 0.0, 0.0, -3.36089262944694129406857109825,
     -0.868219346841726006818189891453, 27.5920996994467083049415600797, 20.1540675504778934086186788979,
     -43.4898841810699588477366255144},
    {0.477662536438264365890433908527, 0.0, 0.0, -2.48811461997166764192642586468,
     -0.590290826836842996371446475743, 21.2300514481811942347288949897, 15.2792336328824235832596922938,
     -33.2882109689848629194453265587, -0.0203312017085086261358222928593},
    {-0.93714243008598732571704021658, 0.0, 0.0, 5.18637242884406370830023853209,
     1.09143734899672957818500254654, -8.14978701074692612513997267357, -18.5200656599969598641566180701,
     22.7394870993505042818970056734, 2.49360555267965238987089396762, -3.0467644718982195003823669022},
    {2.27331014751653820792359768449, 0.0, 0.0, -10.5344954667372501984066689879,
     -2.00087205822486249909675718444, -17.9589318631187989172765950534, 27.9488845294199600508499808837,
     -2.85899827713502369474065508674, -8.87285693353062954433549289258, 12.3605671757943030647266201528,
     0.643392746015763530355970484046},
    {0.0542937341165687622380535766363, 0.0, 0.0, 0.0, 0.0, 4.45031289275240888144113950566,
     1.89151789931450038304281599044, -5.8012039600105847814672114227, 0.31116436695781989440891606237,
     -0.152160949662516078556178806805, 0.201365400804030348374776537501, 0.0447106157277725905176885569043},
}};

/// Order 8 minus order 5.
inline constexpr Row error5{0.01312004499419488073250102996,
                            0.0,
                            0.0,
                            0.0,
                            0.0,
                            -1.225156446376204440720569753,
                            -0.4957589496572501915214079952,
                            1.664377182454986536961530415,
                            -0.350328848749973681688648729,
                            0.3341791187130174790297318841,
                            0.08192320648511571246570742613,
                            -0.02235530786388629525884427845};

/// The quadrature of order 3 that is taken from the solution: of stages 0, 8 and 11.
inline constexpr std::array third{0.244094488188976377952755905512, 0.733846688281611857341361741547,
                                  0.0220588235294117647058823529412};
}  // namespace dopri8

template <System S>
class Dopri8 : public DormandPrince<Dopri8<S>, S, dopri8::a, dopri8::c, 12> {
  using Base = DormandPrince<Dopri8<S>, S, dopri8::a, dopri8::c, 12>;
  friend Adaptive<Dopri8<S>, S>;

 public:
  using State = typename S::State;
  static constexpr int order = 8;
  static constexpr const char* name = "dopri8";
  using Base::Base;

 private:
  using Base::k_, Base::work_;
  static constexpr double error_order = 8.0;
  static constexpr double memory = 0.0;

  /// HNW (II.10.17): error of order 5, damped by that of order 3.
  double attempt(double t, double h, const State& y, const Tolerance& tol) {
    const std::size_t n = this->size();
    this->stages(t, h, y);
    if (!all_finite(n, this->next_)) return std::numeric_limits<double>::quiet_NaN();
    weighted(n, dopri8::error5, k_, h, State{}, work_);
    const double five = scaled_norm(n, work_, y, this->next_, tol);
    for (std::size_t i = 0; i < n; ++i) {
      const double quadrature =
          dopri8::third[0] * k_[0][i] + dopri8::third[1] * k_[8][i] + dopri8::third[2] * k_[11][i];
      work_[i] = this->next_[i] - y[i] - h * quadrature;
    }
    const double three = scaled_norm(n, work_, y, this->next_, tol);
    return five == 0.0 ? 0.0 : five * five / std::sqrt(five * five + 0.01 * three * three);
  }

  void accept(double t, double h, State& y) {
    this->system_->project(this->next_);
    // After the projection: the error has no use for this stage.
    this->system_->slope(t + h, this->next_, k_[12]);
    this->accept_with_slope(y);
  }
};

}  // namespace esmc::host
