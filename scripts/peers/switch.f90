! The Switch half cycle reduced by hand to one boundary value problem for AUTO-07p (IPS = 4).
!
!   slip, time in units of its duration T:  x1' = T x2,  x2' = T (m - g(x2) - sigma2 x2)/J,  x3' = T x1
!   m = -(kp x1 + kd x2 + ki x3),  g(v) = Fc + (Fs - Fc) exp(-(v/vs)^2)
!   x2(0) = 0,  m(0) = Fs (breakaway),  x2(1) = 0 (stop),  x1(1) = -x1(0) (half cycle)
!
! The stick that follows has the closed form T_stick = -(x3(0) + x3(1))/x1(1); period = 2 (T + T_stick).
! PAR: 1 K, 2 T, 3 J, 4 cm, 5 tau_d, 6 tau_i, 7 Fs, 8 Fc, 9 vs, 10 sigma2 (PAR(11) is AUTO's), 12 amplitude, 13 period.
      SUBROUTINE FUNC(NDIM,U,ICP,PAR,IJAC,F,DFDU,DFDP)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM, ICP(*), IJAC
      DOUBLE PRECISION, INTENT(IN) :: U(NDIM), PAR(*)
      DOUBLE PRECISION, INTENT(OUT) :: F(NDIM)
      DOUBLE PRECISION, INTENT(INOUT) :: DFDU(NDIM,NDIM), DFDP(NDIM,*)
      DOUBLE PRECISION m, g, e, kp, kd, ki, fac, T
      fac = PAR(1)*PAR(4)
      kp = fac*(1d0 + PAR(5)/PAR(6))
      kd = fac*PAR(5)
      ki = fac/PAR(6)
      T = PAR(2)
      m = -(kp*U(1) + kd*U(2) + ki*U(3))
      e = (PAR(7) - PAR(8))*EXP(-(U(2)/PAR(9))**2)
      g = PAR(8) + e
      F(1) = T*U(2)
      F(2) = T*(m - g - PAR(10)*U(2))/PAR(3)
      F(3) = T*U(1)
      IF (IJAC.EQ.0) RETURN
      DFDU(1,1) = 0d0
      DFDU(1,2) = T
      DFDU(1,3) = 0d0
      DFDU(2,1) = -T*kp/PAR(3)
      DFDU(2,2) = T*(-kd + 2d0*U(2)/PAR(9)**2*e - PAR(10))/PAR(3)
      DFDU(2,3) = -T*ki/PAR(3)
      DFDU(3,1) = T
      DFDU(3,2) = 0d0
      DFDU(3,3) = 0d0
      IF (IJAC.EQ.1) RETURN
      DFDP(1,1) = 0d0
      DFDP(2,1) = T*m/PAR(1)/PAR(3)
      DFDP(3,1) = 0d0
      DFDP(1,2) = F(1)/T
      DFDP(2,2) = F(2)/T
      DFDP(3,2) = F(3)/T
      END SUBROUTINE FUNC

      SUBROUTINE STPNT(NDIM,U,PAR,X)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM
      DOUBLE PRECISION, INTENT(INOUT) :: U(NDIM), PAR(*)
      DOUBLE PRECISION, INTENT(IN) :: X
      OPEN(UNIT=77, FILE='parameters.txt', STATUS='old')
      READ(77,*) PAR(1:10)
      CLOSE(77)
      END SUBROUTINE STPNT

      SUBROUTINE BCND(NDIM,PAR,ICP,NBC,U0,U1,FB,IJAC,DBC)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM, ICP(*), NBC, IJAC
      DOUBLE PRECISION, INTENT(IN) :: PAR(*), U0(NDIM), U1(NDIM)
      DOUBLE PRECISION, INTENT(OUT) :: FB(NBC)
      DOUBLE PRECISION, INTENT(INOUT) :: DBC(NBC,*)
      DOUBLE PRECISION fac
      fac = PAR(1)*PAR(4)
      FB(1) = U0(2)
      FB(2) = -fac*((1d0 + PAR(5)/PAR(6))*U0(1) + PAR(5)*U0(2) + U0(3)/PAR(6)) - PAR(7)
      FB(3) = U1(2)
      FB(4) = U0(1) + U1(1)
      END SUBROUTINE BCND

      SUBROUTINE PVLS(NDIM,U,PAR)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM
      DOUBLE PRECISION, INTENT(IN) :: U(NDIM)
      DOUBLE PRECISION, INTENT(INOUT) :: PAR(*)
      DOUBLE PRECISION, EXTERNAL :: GETP
      PAR(12) = GETP('BV1',1,U)
      PAR(13) = 2d0*(PAR(2) - (GETP('BV0',3,U) + GETP('BV1',3,U))/GETP('BV1',1,U))
      END SUBROUTINE PVLS

      SUBROUTINE ICND
      END SUBROUTINE ICND

      SUBROUTINE FOPT
      END SUBROUTINE FOPT
