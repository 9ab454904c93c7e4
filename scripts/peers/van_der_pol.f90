! Van der Pol's oscillator as a periodic orbit for AUTO-07p (IPS = 2).
!
!   x' = v,  v' = mu (1 - x^2) v - x
!
! PAR: 1 mu, 11 period.
      SUBROUTINE FUNC(NDIM,U,ICP,PAR,IJAC,F,DFDU,DFDP)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM, ICP(*), IJAC
      DOUBLE PRECISION, INTENT(IN) :: U(NDIM), PAR(*)
      DOUBLE PRECISION, INTENT(OUT) :: F(NDIM)
      DOUBLE PRECISION, INTENT(INOUT) :: DFDU(NDIM,NDIM), DFDP(NDIM,*)
      F(1) = U(2)
      F(2) = PAR(1)*(1d0 - U(1)**2)*U(2) - U(1)
      IF (IJAC.EQ.0) RETURN
      DFDU(1,1) = 0d0
      DFDU(1,2) = 1d0
      DFDU(2,1) = -2d0*PAR(1)*U(1)*U(2) - 1d0
      DFDU(2,2) = PAR(1)*(1d0 - U(1)**2)
      IF (IJAC.EQ.1) RETURN
      DFDP(1,1) = 0d0
      DFDP(2,1) = (1d0 - U(1)**2)*U(2)
      END SUBROUTINE FUNC

      SUBROUTINE STPNT(NDIM,U,PAR,X)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM
      DOUBLE PRECISION, INTENT(INOUT) :: U(NDIM), PAR(*)
      DOUBLE PRECISION, INTENT(IN) :: X
      OPEN(UNIT=77, FILE='parameters.txt', STATUS='old')
      READ(77,*) PAR(1), PAR(11)
      CLOSE(77)
      END SUBROUTINE STPNT

      SUBROUTINE PVLS(NDIM,U,PAR)
      END SUBROUTINE PVLS

      SUBROUTINE BCND
      END SUBROUTINE BCND

      SUBROUTINE ICND
      END SUBROUTINE ICND

      SUBROUTINE FOPT
      END SUBROUTINE FOPT
