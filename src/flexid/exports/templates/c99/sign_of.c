static flexid_real sign_of(flexid_real number)
{
    flexid_real sign = REAL(0.0);
    if (number > REAL(0.0)) {
        sign = REAL(1.0);
    } else if (number < REAL(0.0)) {
        sign = -REAL(1.0);
    } else {
        /* 0 */
    }
    return sign;
}

