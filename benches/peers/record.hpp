// What C++ peers share: PROGRAM WORKLOAD FILE ROUNDS.
//
// FILE holds two rows of f64: outputs, then positions. Printed are the least process time of a round, s, then x and the
// diagonal of P, each on a line.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <exception>
#include <vector>

struct Data {
    std::vector<double> u, z;
};

// From a record to x and the diagonal of P.
using Work = std::vector<double> (*)(const Data&);

inline double seconds() {
    timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
}

inline Data read(const char* name) {
    std::FILE* file = std::fopen(name, "rb");
    if (!file) throw std::exception();
    std::fseek(file, 0, SEEK_END);
    const std::size_t n = std::size_t(std::ftell(file)) / sizeof(double) / 2;
    std::rewind(file);
    Data data{std::vector<double>(n), std::vector<double>(n)};
    const bool whole = std::fread(data.u.data(), sizeof(double), n, file) == n &&
                       std::fread(data.z.data(), sizeof(double), n, file) == n;
    std::fclose(file);
    if (!whole) throw std::exception();
    return data;
}

// The program of the workloads W1 to W4.
inline int run(int count, char** arguments, const Work (&works)[4]) {
    const int workload = count == 4 ? std::atoi(arguments[1]) : 0;
    if (workload < 1 || workload > 4) {
        std::fprintf(stderr, "usage: %s WORKLOAD FILE ROUNDS\n", arguments[0]);
        return 2;
    }
    const Data data = read(arguments[2]);
    double least = INFINITY;
    std::vector<double> ended;
    for (int round = std::atoi(arguments[3]); round >= 0; --round) {
        const double start = seconds();
        ended = works[workload - 1](data);
        least = std::min(least, seconds() - start);
    }
    std::printf("%.17g\n", least);
    for (std::size_t i = 0; i < ended.size(); ++i)
        std::printf("%.17g%c", ended[i], (i + 1) % (ended.size() / 2) == 0 ? '\n' : ' ');
    return 0;
}
