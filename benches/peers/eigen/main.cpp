// The workloads W1 to W4 on dense fixed-size Eigen matrices.
#include <Eigen/Dense>

#include "../record.hpp"

namespace {

constexpr double dt = 1.0 / 1667.0, q = 1e-4 * dt, jerk = 25.0, r_position = 1e-12, r_output = 1e-4;

template <int N> using Vector = Eigen::Matrix<double, N, 1>;
template <int N> using Matrix = Eigen::Matrix<double, N, N>;

template <int N> struct Belief {
    Vector<N> x;
    Matrix<N> P;
};

template <int N> Belief<N> prior(int motion) {
    const double parameters[] = {1e-4, 1e-2, 1e-6, 1e-8};
    Belief<N> b{Vector<N>::Zero(), Matrix<N>::Zero()};
    b.P(0, 0) = 1e-10;
    b.P(1, 1) = 1e-2;
    if (motion == 3) b.P(2, 2) = 1.0;
    for (int i = motion; i < N; ++i) b.P(i, i) = parameters[i - motion];
    return b;
}

// Joseph form; `S_extra` and `z_extra` are the second-order terms.
template <int N>
void update(Belief<N>& b, const Eigen::Matrix<double, 1, N>& H, double e, double R, double extra) {
    const Vector<N> PHt = b.P * H.transpose();
    const Vector<N> gain = PHt / (H.dot(PHt) + R + extra);
    const Matrix<N> IKH = Matrix<N>::Identity() - gain * H;
    b.x += gain * e;
    b.P = (IKH * b.P * IKH.transpose() + gain * gain.transpose() * (R + extra)).eval();
}

template <int N> void read_position(Belief<N>& b, double z) {
    Eigen::Matrix<double, 1, N> H = Eigen::Matrix<double, 1, N>::Zero();
    H(0) = 1.0;
    update<N>(b, H, z - b.x(0), r_position, 0.0);
}

// x' and P' of the ACI system (9) with the inverse sensor (5)(6); second order where N = 6.
template <int N> Belief<N> rates(const Belief<N>& b, double u) {
    const double w = u - b.x(3), k = b.x(2);
    const double K2 = N == 6 ? b.x(N - 2) : 0.0, K3 = N == 6 ? b.x(N - 1) : 0.0;
    Matrix<N> F = Matrix<N>::Zero();
    F(0, 1) = 1.0;
    F(1, 2) = -w;
    F(1, 3) = -((1.0 - k) + 2.0 * K2 * w + 3.0 * K3 * w * w);
    double a = (1.0 - k) * w + K2 * w * w + K3 * w * w * w;
    if constexpr (N == 6) {
        F(1, 4) = w * w;
        F(1, 5) = w * w * w;
        Matrix<N> hessian = Matrix<N>::Zero();
        hessian(2, 3) = hessian(3, 2) = 1.0;
        hessian(3, 3) = 2.0 * K2 + 6.0 * K3 * w;
        hessian(3, 4) = hessian(4, 3) = -2.0 * w;
        hessian(3, 5) = hessian(5, 3) = -3.0 * w * w;
        a += 0.5 * (hessian * b.P).trace();
    }
    Belief<N> d{Vector<N>::Zero(), F * b.P};
    d.P += d.P.transpose().eval();
    d.P(1, 1) += q;
    d.x(0) = b.x(1);
    d.x(1) = a;
    return d;
}

template <int N> std::vector<double> ended(const Belief<N>& b) {
    std::vector<double> numbers(b.x.data(), b.x.data() + N);
    for (int i = 0; i < N; ++i) numbers.push_back(b.P(i, i));
    return numbers;
}

template <int N> Belief<N> ahead(const Belief<N>& b, const Belief<N>& d, double h) {
    return {b.x + h * d.x, b.P + h * d.P};
}

template <int N> std::vector<double> aci(const Data& data) {
    Belief<N> b = prior<N>(2);
    for (std::size_t j = 0; j + 1 < data.u.size(); ++j) {
        const double u0 = data.u[j], u1 = data.u[j + 1], um = 0.5 * (u0 + u1);
        const Belief<N> d1 = rates<N>(b, u0);
        const Belief<N> d2 = rates<N>(ahead<N>(b, d1, 0.5 * dt), um);
        if constexpr (N == 4) {
            b = ahead<N>(b, d2, dt);
        } else {
            const Belief<N> d3 = rates<N>(ahead<N>(b, d2, 0.5 * dt), um);
            const Belief<N> d4 = rates<N>(ahead<N>(b, d3, dt), u1);
            b.x += dt / 6.0 * (d1.x + 2.0 * d2.x + 2.0 * d3.x + d4.x);
            b.P += dt / 6.0 * (d1.P + 2.0 * d2.P + 2.0 * d3.P + d4.P);
        }
        if (!std::isnan(data.z[j + 1])) read_position<N>(b, data.z[j + 1]);
    }
    return ended<N>(b);
}

// The output's reading of CWPA (10) with the forward sensor (3)(4); second order where N = 7.
template <int N> void read_output(Belief<N>& b, double z) {
    const double a = b.x(2), k = b.x(3), K0 = b.x(4);
    const double K2 = N == 7 ? b.x(N - 2) : 0.0, K3 = N == 7 ? b.x(N - 1) : 0.0;
    Eigen::Matrix<double, 1, N> H = Eigen::Matrix<double, 1, N>::Zero();
    H(2) = 1.0 + k + 2.0 * K2 * a + 3.0 * K3 * a * a;
    H(3) = a;
    H(4) = 1.0;
    double expected = K0 + (1.0 + k) * a + K2 * a * a + K3 * a * a * a, extra = 0.0;
    if constexpr (N == 7) {
        H(5) = a * a;
        H(6) = a * a * a;
        Matrix<N> hessian = Matrix<N>::Zero();
        hessian(2, 2) = 2.0 * K2 + 6.0 * K3 * a;
        hessian(2, 3) = hessian(3, 2) = 1.0;
        hessian(2, 5) = hessian(5, 2) = 2.0 * a;
        hessian(2, 6) = hessian(6, 2) = 3.0 * a * a;
        const Matrix<N> HP = hessian * b.P;
        expected += 0.5 * HP.trace();
        extra = 0.5 * (HP * HP).trace();
    }
    update<N>(b, H, z - expected, r_output, extra);
}

template <int N> std::vector<double> cwpa(const Data& data) {
    Matrix<N> F = Matrix<N>::Identity(), Q = Matrix<N>::Zero();
    F(0, 1) = F(1, 2) = dt;
    F(0, 2) = 0.5 * dt * dt;
    Q.template topLeftCorner<3, 3>() << std::pow(dt, 5) / 20.0, std::pow(dt, 4) / 8.0, std::pow(dt, 3) / 6.0,
        std::pow(dt, 4) / 8.0, std::pow(dt, 3) / 3.0, dt * dt / 2.0, std::pow(dt, 3) / 6.0, dt * dt / 2.0, dt;
    Q *= jerk;
    Belief<N> b = prior<N>(3);
    for (std::size_t j = 1; j < data.u.size(); ++j) {
        b.x = (F * b.x).eval();
        b.P = (F * b.P * F.transpose() + Q).eval();
        read_output<N>(b, data.u[j]);
        if (!std::isnan(data.z[j])) read_position<N>(b, data.z[j]);
    }
    return ended<N>(b);
}

} // namespace

int main(int count, char** arguments) { return run(count, arguments, {aci<4>, aci<6>, cwpa<5>, cwpa<7>}); }
