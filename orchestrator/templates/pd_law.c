    double e[6], tau[6];
    for (int i = 0; i < 6; i++) {
        e[i] = v[ETA_D + i] - v[ETA + i]; /* N E D [m], phi theta psi [rad] */
        if (i >= 3) e[i] = atan2(sin(e[i]), cos(e[i]));
    }
    const double c = cos(v[ETA + 5]), s = sin(v[ETA + 5]);
    const double ahead = c * e[0] + s * e[1], across = c * e[1] - s * e[0];
    e[0] = ahead;
    e[1] = across;
    for (int i = 0; i < 6; i++) tau[i] = v[KP + i] * e[i] - v[KD + i] * v[NU + i];
    memcpy(&v[TAU_D], tau, sizeof tau);
