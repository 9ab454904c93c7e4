! The LuGre servo as a periodic orbit for AUTO-07p (IPS = 2), as a user of AUTO would write it.
!
!   x1' = x2,  J x2' = m - F,  x3' = x1,  z' = x2 - sigma0 |x2| z/g(x2),  F = sigma0 z + sigma1 z' + sigma2 x2
!   m = -(kp x1 + kd x2 + ki x3),  g(v) = Fc + (Fs - Fc) exp(-(v/vs)^2)
!
! The bristle is carried as the torque U4 = sigma0 z, so that all states are of the same order.
! PAR: 1 K, 3 J, 4 cm, 5 tau_d, 6 tau_i, 7 Fs, 8 Fc, 9 vs, 10 sigma2, 11 period, 12 sigma0, 13 sigma1, 14 max x1.
      SUBROUTINE FUNC(NDIM,U,ICP,PAR,IJAC,F,DFDU,DFDP)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM, ICP(*), IJAC
      DOUBLE PRECISION, INTENT(IN) :: U(NDIM), PAR(*)
      DOUBLE PRECISION, INTENT(OUT) :: F(NDIM)
      DOUBLE PRECISION, INTENT(INOUT) :: DFDU(NDIM,NDIM), DFDP(NDIM,*)
      DOUBLE PRECISION m, g, e, dg, kp, kd, ki, fac, rate, s, r2, r4
      fac = PAR(1)*PAR(4)
      kp = fac*(1d0 + PAR(5)/PAR(6))
      kd = fac*PAR(5)
      ki = fac/PAR(6)
      m = -(kp*U(1) + kd*U(2) + ki*U(3))
      e = (PAR(7) - PAR(8))*EXP(-(U(2)/PAR(9))**2)
      g = PAR(8) + e
      rate = U(2) - ABS(U(2))*U(4)/g
      F(1) = U(2)
      F(2) = (m - U(4) - PAR(13)*rate - PAR(10)*U(2))/PAR(3)
      F(3) = U(1)
      F(4) = PAR(12)*rate
      IF (IJAC.EQ.0) RETURN
      s = SIGN(1d0, U(2))
      dg = -2d0*U(2)/PAR(9)**2*e
      r2 = 1d0 - s*U(4)/g + ABS(U(2))*U(4)*dg/g**2
      r4 = -ABS(U(2))/g
      DFDU(1:4,1:4) = 0d0
      DFDU(1,2) = 1d0
      DFDU(2,1) = -kp/PAR(3)
      DFDU(2,2) = (-kd - PAR(13)*r2 - PAR(10))/PAR(3)
      DFDU(2,3) = -ki/PAR(3)
      DFDU(2,4) = (-1d0 - PAR(13)*r4)/PAR(3)
      DFDU(3,1) = 1d0
      DFDU(4,2) = PAR(12)*r2
      DFDU(4,4) = PAR(12)*r4
      IF (IJAC.EQ.1) RETURN
      DFDP(1:4,1) = 0d0
      DFDP(2,1) = m/PAR(1)/PAR(3)
      END SUBROUTINE FUNC

      SUBROUTINE STPNT(NDIM,U,PAR,X)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM
      DOUBLE PRECISION, INTENT(INOUT) :: U(NDIM), PAR(*)
      DOUBLE PRECISION, INTENT(IN) :: X
      OPEN(UNIT=77, FILE='parameters.txt', STATUS='old')
      READ(77,*) PAR(1:13)
      CLOSE(77)
      END SUBROUTINE STPNT

      SUBROUTINE PVLS(NDIM,U,PAR)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM
      DOUBLE PRECISION, INTENT(IN) :: U(NDIM)
      DOUBLE PRECISION, INTENT(INOUT) :: PAR(*)
      DOUBLE PRECISION, EXTERNAL :: GETP
      PAR(14) = GETP('MAX',1,U)
      END SUBROUTINE PVLS

      SUBROUTINE BCND
      END SUBROUTINE BCND

      SUBROUTINE ICND
      END SUBROUTINE ICND

      SUBROUTINE FOPT
      END SUBROUTINE FOPT
